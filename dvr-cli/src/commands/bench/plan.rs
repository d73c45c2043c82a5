//! The runs of a benchmark.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::dataset::{ReadOptions, digest_of_scene};
use dvr_core::mesh::read_mesh;
use dvr_core::metrics::points::PointsSettings;
use dvr_core::record::{Digest, RecordKey};
use dvr_train::{PointsEvaluation, RunFolder, RunMetrics};
use serde_json::json;

use super::results::Outcome;
use crate::args::{BenchArgs, Variant};
use crate::commands::job::{Ended, Job};
use crate::commands::kept_row::{Kept, keep, kept};

/// A scene of the benchmark.
pub struct BenchScene {
    path: PathBuf,
    name: String,
    digest: Digest,
    /// Verified points in its folder.
    points: Option<PathBuf>,
}

/// One run of the plan.
pub struct Run<'a> {
    scene: &'a BenchScene,
    variant: Variant,
    supervision: String,
    seed: u64,
    /// Its folder's name.
    pub folder: String,
    key: RecordKey,
}

/// The scenes of the arguments. What lies in the folder of results is not part of a scene.
///
/// # Errors
/// When a scene cannot be read, or there are no points of the name that was given.
pub fn scenes(args: &BenchArgs) -> Result<Vec<BenchScene>> {
    let points = |path: &Path| {
        let folder = if path.is_dir() { path } else { path.parent()? };
        Some(folder.join(args.points.as_ref()?)).filter(|file| file.is_file())
    };
    let scene = |(path, name): (PathBuf, String)| {
        let digest = digest_of_scene(&path, &ReadOptions::default(), Some(&args.out))?;
        Ok(BenchScene { points: points(&path), path, name, digest })
    };
    let scenes: Vec<BenchScene> = named(&args.scenes)?.into_iter().map(scene).collect::<Result<_>>()?;
    match &args.points {
        Some(name) if scenes.iter().all(|scene| scene.points.is_none()) => {
            bail!("--points {}: none of the scenes has a file of this name in its folder", name.display())
        }
        _ => Ok(scenes),
    }
}

/// Scenes with their names: the folder's name, preceded by its parent's where several folders have the same name.
fn named(paths: &[PathBuf]) -> Result<Vec<(PathBuf, String)>> {
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
///
/// # Errors
/// When a training would refuse its settings.
pub fn plan<'a>(args: &BenchArgs, scenes: &'a [BenchScene]) -> Result<Vec<Run<'a>>> {
    let mut plan = Vec::new();
    for scene in scenes {
        for supervision in &args.supervision {
            for variant in args.variants() {
                let seeds = if variant.method == "hull" { 1 } else { args.seeds };
                for seed in 0..seeds {
                    plan.push(Run::new(args, scene, variant.clone(), supervision.to_string(), seed)?);
                }
            }
        }
    }
    Ok(plan)
}

impl<'a> Run<'a> {
    fn new(args: &BenchArgs, scene: &'a BenchScene, variant: Variant, supervision: String, seed: u64) -> Result<Self> {
        let folder = folder_name(&scene.name, &variant.name, &supervision, seed);
        let run = RunFolder::new(args.out.join("runs").join(&folder));
        let token = Cancellation::default();
        let job = job(args, scene, &run, &variant, &supervision, seed, &token);
        let mut settings = job.settings().with_context(|| folder.clone())?;
        if scene.points.is_some() {
            // The scene's digest has the points themselves.
            settings["points"] = json!(args.points);
        }
        let key = job.record_key(scene.digest.clone(), &settings)?;
        Ok(Self { scene, variant, supervision, seed, folder, key })
    }

    /// The outcome that is kept, if it has the key of this run.
    ///
    /// # Errors
    /// When its file is damaged.
    pub fn kept(&self, args: &BenchArgs) -> Result<Kept<Outcome>> {
        kept(&self.file(args), &self.key)
    }

    /// The outcome of the run, which is carried out unless it is kept. A failure is an outcome, but not kept.
    ///
    /// # Errors
    /// When the training cannot be started, the outcome not be stored, or somebody wanted it to end.
    pub fn outcome(&self, args: &BenchArgs, cancellation: &Cancellation) -> Result<Outcome> {
        if let Kept::Row(outcome) = self.kept(args)? {
            return Ok(outcome);
        }
        let folder = RunFolder::new(args.out.join("runs").join(&self.folder));
        let blank = Outcome::blank(&self.scene.name, &self.variant.name, &self.supervision, self.seed, &self.key);
        let job = job(args, self.scene, &folder, &self.variant, &self.supervision, self.seed, cancellation);
        Ok(match job.run()? {
            Ended::Measured { metrics, seconds } => {
                let points = self.points(&metrics, &folder)?;
                keep(&self.file(args), &self.key, blank.measured(seconds, &metrics, points.as_ref()))?
            }
            Ended::Failed { said, .. } => Outcome { failure: Some(said), ..blank },
        })
    }

    /// The mesh against the points in the scene's folder, else against those that the scene's files bring, where the
    /// method was not trained on them.
    fn points(&self, metrics: &RunMetrics, folder: &RunFolder) -> Result<Option<PointsEvaluation>> {
        let Some(file) = self.scene.points.as_ref().filter(|_| metrics.mesh.is_some()) else {
            return Ok(metrics.points.clone().filter(|points| points.not_independent.is_none()));
        };
        let mesh = read_mesh(folder.mesh_ply())?.mesh;
        Ok(Some(PointsEvaluation::of_file(&mesh, file, None, false, &PointsSettings::default())?))
    }

    /// Where the outcome is kept.
    fn file(&self, args: &BenchArgs) -> PathBuf {
        args.out.join("runs").join(format!("{}.json", self.folder))
    }
}

/// The training of a run.
fn job<'a>(
    args: &BenchArgs,
    scene: &'a BenchScene,
    folder: &'a RunFolder,
    variant: &'a Variant,
    supervision: &'a str,
    seed: u64,
    cancellation: &'a Cancellation,
) -> Job<'a> {
    let BenchArgs { downscale, time, follow_shape, .. } = *args;
    Job { scene: &scene.path, folder, variant, supervision, seed, downscale, time, follow_shape, cancellation }
}
