//! The runs of a benchmark.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use dvr_train::RunFolder;

use super::results::Outcome;
use crate::args::{BenchArgs, Variant};
use crate::commands::job::{Ended, Job, once};

/// One run of the plan.
pub struct Run<'a> {
    scene: &'a Path,
    name: &'a str,
    variant: Variant,
    supervision: String,
    seed: u64,
    /// Its folder's name.
    pub folder: String,
}

/// Scenes with their names: the folder's name, preceded by its parent's where several folders have the same name.
pub fn named(paths: &[PathBuf]) -> Result<Vec<(PathBuf, String)>> {
    let mut parts: Vec<Vec<String>> = Vec::new();
    for path in paths {
        let whole = std::fs::canonicalize(path).with_context(|| path.display().to_string())?;
        let mut names: Vec<String> =
            whole.iter().rev().take(3).map(|part| part.to_string_lossy().into_owned()).collect();
        // `bunny/bunny` is `bunny`.
        names.dedup();
        parts.push(names);
    }
    let name = |own: &Vec<String>| {
        let is_alone = parts.iter().filter(|other| other[0] == own[0]).count() == 1;
        match own.get(1).filter(|_| !is_alone) {
            Some(above) => format!("{above}.{}", own[0]),
            None => own[0].clone(),
        }
    };
    Ok(paths.iter().cloned().zip(parts.iter().map(name)).collect())
}

/// Name of a run's folder.
pub fn folder_name(scene: &str, method: &str, supervision: &str, seed: u64) -> String {
    format!("{scene}.{method}.{supervision}.{seed}")
}

/// All runs, seeds innermost. Deterministic methods run once.
pub fn plan<'a>(args: &'a BenchArgs, scenes: &'a [(PathBuf, String)]) -> Vec<Run<'a>> {
    let mut plan = Vec::new();
    for (scene, name) in scenes {
        for supervision in &args.supervision {
            for variant in args.variants() {
                let seeds = if variant.method == "hull" { 1 } else { args.seeds };
                for seed in 0..seeds {
                    let supervision = supervision.to_string();
                    let folder = folder_name(name, &variant.name, &supervision, seed);
                    plan.push(Run { scene, name, variant: variant.clone(), supervision, seed, folder });
                }
            }
        }
    }
    plan
}

impl Run<'_> {
    /// The outcome of the run, which is carried out unless its figures are stored.
    pub fn outcome(&self, args: &BenchArgs) -> Result<Outcome> {
        let folder = RunFolder::new(args.out.join("runs").join(&self.folder));
        once(&args.out.join("runs").join(format!("{}.json", self.folder)), || {
            let job = Job {
                scene: self.scene,
                folder: &folder,
                variant: &self.variant,
                supervision: &self.supervision,
                seed: self.seed,
                time: args.time,
                follow_shape: args.follow_shape,
            };
            match job.run()? {
                Ended::Measured { metrics, seconds } => {
                    Ok(Outcome::new(self.name, &self.variant.name, &self.supervision, seconds, &metrics))
                }
                Ended::Failed { said, .. } => bail!("{} failed: {said}", self.folder),
            }
        })
    }
}
