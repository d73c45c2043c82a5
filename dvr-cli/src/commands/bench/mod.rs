//! `dvr bench`: methods side by side on the same scenes, on the same machine, with their spread over seeds.

mod charts;
mod results;
mod table;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use dvr_core::files::write_bytes_atomically;
use dvr_train::{Observer, RunFolder};

use super::job::{Ended, Job, once};
use super::machine::Machine;
use crate::args::{BenchArgs, Variant};
use crate::progress::Progress;
use results::{Outcome, Results};

/// Runs what is missing, then writes `results.json`, `results.csv`, `table.md`, `charts/` and `report.html`.
pub fn run(args: &BenchArgs) -> Result<ExitCode> {
    let scenes = named(&args.scenes)?;
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let plan = plan(args, &scenes);
    let mut results = Results::new(Machine::this());
    let mut progress = Progress::new();
    progress.phase("runs", plan.len());
    for (i, run) in plan.iter().enumerate() {
        results.outcomes.push(run.outcome(args)?);
        progress.progress(i + 1, &run.folder);
    }
    for path in &args.overlay {
        results.outcomes.extend(results::read(path)?);
    }
    results.write(&args.out.join("results.json"))?;
    write_bytes_atomically(&args.out.join("results.csv"), table::csv(&results.outcomes)?.as_bytes())?;
    let table = table::markdown(&results);
    write_bytes_atomically(&args.out.join("table.md"), table.as_bytes())?;
    charts::write(&results, &args.out)?;
    println!("{table}");
    for name in ["results.json", "results.csv", "table.md", "charts", "report.html"] {
        eprintln!("wrote {}", args.out.join(name).display());
    }
    Ok(ExitCode::SUCCESS)
}

/// One run of the plan.
struct Run<'a> {
    scene: &'a Path,
    name: &'a str,
    variant: Variant,
    supervision: String,
    seed: u64,
    /// Its folder's name.
    folder: String,
}

/// Scenes with their names: their folder's, and the one above it where several have the same.
fn named(paths: &[PathBuf]) -> Result<Vec<(PathBuf, String)>> {
    let mut parts: Vec<Vec<String>> = Vec::new();
    for path in paths {
        let whole = std::fs::canonicalize(path).with_context(|| path.display().to_string())?;
        let mut names: Vec<String> =
            whole.iter().rev().take(3).map(|part| part.to_string_lossy().into_owned()).collect();
        // `bunny/bunny` says no more than `bunny`.
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

/// What the folder of a run is called.
fn folder_name(scene: &str, method: &str, supervision: &str, seed: u64) -> String {
    format!("{scene}.{method}.{supervision}.{seed}")
}

/// All runs, seeds innermost. Methods that leave nothing to chance run once.
fn plan<'a>(args: &'a BenchArgs, scenes: &'a [(PathBuf, String)]) -> Vec<Run<'a>> {
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
    /// What the run came to: carried out now, unless its figures are there already.
    fn outcome(&self, args: &BenchArgs) -> Result<Outcome> {
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
                Ended::Failed { said, .. } => bail!("{} did not get through: {said}", self.folder),
            }
        })
    }
}
