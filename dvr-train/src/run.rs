//! A training run from start to end: folder, checkpoints, validation, and what is written when it is over.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::Scene;
use dvr_model::Decoder;
use dvr_render::{FieldShader, MarchSettings, RenderSettings};

use crate::checkpoint::{Best, CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::metrics_log::MetricsLog;
use crate::sparse::SparseTargets;
use crate::trainer::{Trainer, ViewSplit};
use crate::validate::{Agreement, agreement};
use crate::warm_start::{carve_hull, hull_bound, warm_start};

/// Where the parts of a run lie.
#[derive(Clone, Debug)]
pub struct RunFolder {
    root: PathBuf,
}

impl RunFolder {
    /// Names a folder; nothing is touched.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The newest checkpoint.
    pub fn last(&self) -> PathBuf {
        self.root.join("last.ckpt")
    }

    /// The checkpoint with the best validation.
    pub fn best(&self) -> PathBuf {
        self.root.join("best.ckpt")
    }

    /// The configuration, for people to read.
    pub fn config(&self) -> PathBuf {
        self.root.join("config.json")
    }

    /// The curves.
    pub fn metrics_csv(&self) -> PathBuf {
        self.root.join("metrics.csv")
    }

    /// The final figures.
    pub fn metrics_json(&self) -> PathBuf {
        self.root.join("metrics.json")
    }

    /// The mesh with vertex colours, as PLY.
    pub fn mesh_ply(&self) -> PathBuf {
        self.root.join("mesh.ply")
    }

    /// The same mesh as GLB.
    pub fn mesh_glb(&self) -> PathBuf {
        self.root.join("mesh.glb")
    }

    /// Input, render, depth and normals side by side.
    pub fn preview(&self) -> PathBuf {
        self.root.join("preview.png")
    }

    /// Makes an empty folder for a new run.
    ///
    /// # Errors
    /// When it cannot be made, cannot be written to, or already holds a run.
    pub fn create(&self) -> Result<()> {
        if self.last().exists() {
            return Err(Error::Run {
                path: self.root.clone(),
                problem: "the folder already holds a run".into(),
                remedy: "Continue it with --resume, start over with --overwrite, or choose another folder.".into(),
            });
        }
        std::fs::create_dir_all(&self.root).map_err(|e| dvr_core::Error::io(&self.root, e))?;
        Ok(())
    }

    /// Removes what an earlier run left, and nothing else.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn clear(&self) -> Result<()> {
        let files = [
            self.last(),
            self.best(),
            self.config(),
            self.metrics_csv(),
            self.metrics_json(),
            self.mesh_ply(),
            self.mesh_glb(),
            self.preview(),
        ];
        for file in files.into_iter().filter(|file| file.exists()) {
            std::fs::remove_file(&file).map_err(|e| dvr_core::Error::io(&file, e))?;
        }
        Ok(())
    }

    /// The checkpoint that stands for the run: the best, or the last where nothing was validated.
    ///
    /// # Errors
    /// When there is none or it cannot be read.
    pub fn load(&self) -> Result<Checkpoint> {
        if self.best().exists() { Checkpoint::load(&self.best()) } else { Checkpoint::load(&self.last()) }
    }
}

/// Hears how a run goes on.
pub trait Observer {
    /// A phase of so many steps begins.
    fn phase(&mut self, name: &str, steps: usize);
    /// So many steps of the phase are done.
    fn progress(&mut self, done: usize, message: &str);
    /// Something worth a line.
    fn note(&mut self, line: &str);
}

/// How a run is carried out, besides its configuration.
pub struct RunOptions<'a> {
    /// The folder.
    pub folder: RunFolder,
    /// The device, without autodiff.
    pub device: Device,
    /// How the scene was read; stored in checkpoints.
    pub reading: serde_json::Value,
    /// Wall time after which training stops as if its steps were done.
    pub time_limit: Option<Duration>,
    /// Set from outside (Ctrl-C): training saves and stops after the current step.
    pub interrupted: &'a AtomicBool,
}

/// Why training stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// All steps are done.
    Done,
    /// The time is up.
    TimeLimit,
    /// Somebody asked.
    Interrupted,
}

/// What training left.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The checkpoint that stands for the run.
    pub checkpoint: Checkpoint,
    /// Why it stopped.
    pub stop: Stop,
    /// Steps done, over all sessions.
    pub steps: usize,
    /// Wall seconds of training, over all sessions.
    pub seconds: f64,
    /// The last validation.
    pub validation: Option<Agreement>,
}

/// Steps between rows of `metrics.csv`.
const LOG_EVERY: usize = 10;

/// Pixels that a validation during training looks at: with fewer, its noise would choose the best checkpoint.
const VALIDATION_PIXELS: usize = 8192;

/// Trains a decoder on a scene from where `resume_from` left it, or from the start.
///
/// # Errors
/// When the scene has too few views, a file cannot be written, or the loss diverges.
pub fn train(
    scene: &Scene,
    config: TrainConfig,
    resume_from: Option<&Checkpoint>,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<Trained> {
    config.check()?;
    let views = ViewSplit::new(scene, config.hold_out_every)?;
    let held_out: Vec<String> = views.held_out.iter().map(|view| view.name.clone()).collect();
    let autodiff = options.device.clone().autodiff();
    options.device.seed(config.seed);
    let field = config.model.init(&autodiff);
    let before = resume_from.map_or(0.0, |c| c.header.seconds);
    let start = Instant::now();
    let elapsed = || before + start.elapsed().as_secs_f64();

    let hull = carve_hull(&views.train, config.hull.resolution)?;
    if hull.is_empty() {
        observer.note("the masks have no visual hull in common: training starts from noise (see `dvr info`)");
    }
    let field = match resume_from {
        Some(checkpoint) => checkpoint.restore_model(field)?,
        None if hull.is_empty() || config.hull.warm_start_steps == 0 => field,
        None => {
            observer.phase("fitting the visual hull", config.hull.warm_start_steps);
            let progress = |done| observer.progress(done, "");
            warm_start(field, &hull, &config, &options.device, options.interrupted, progress)
        }
    };
    let bound = if config.hull.bound_rays { hull_bound(&hull) } else { None };
    let sparse = SparseTargets::new(scene, &views.train);
    let trainer = Trainer::new(field, views, config.clone(), options.device.clone());
    let mut trainer = trainer.with_bound(bound).with_sparse_targets(sparse);
    let mut log = MetricsLog::default();
    let mut best = None;
    if let Some(checkpoint) = resume_from {
        trainer.resume(checkpoint)?;
        log = MetricsLog::resume(&options.folder.metrics_csv(), checkpoint.header.step)?;
        best = checkpoint.header.best;
    }
    let header = |step, best, seconds| CheckpointHeader {
        version: CHECKPOINT_VERSION,
        config: config.clone(),
        step,
        seconds,
        best,
        scene: scene.source.clone(),
        reading: options.reading.clone(),
        object_to_world: scene.object_to_world,
        held_out: held_out.clone(),
    };

    observer.phase("training", config.steps);
    let mut stop = Stop::Done;
    let mut validation = None;
    while trainer.steps_done() < config.steps {
        let report = trainer.step()?;
        let step = report.step;
        let last = step == config.steps;
        stop = match () {
            () if options.interrupted.load(Ordering::Relaxed) => Stop::Interrupted,
            () if options.time_limit.is_some_and(|limit| elapsed() >= limit.as_secs_f64()) => Stop::TimeLimit,
            () => Stop::Done,
        };
        let ending = last || stop != Stop::Done;
        let validate_now = step % config.validate_every == 0 || (ending && stop != Stop::Interrupted);
        if validate_now {
            validation = validate(&trainer);
        }
        if step % LOG_EVERY == 0 || validate_now {
            log.push(&report, elapsed(), validation.as_ref().filter(|_| validate_now));
        }
        if let Some(found) = validation.filter(|_| validate_now)
            && best.is_none_or(|best: Best| found.psnr > best.psnr)
        {
            best = Some(Best { step, psnr: found.psnr });
            trainer.checkpoint(header(step, best, elapsed()))?.save(&options.folder.best())?;
        }
        if ending || step % config.checkpoint_every == 0 {
            trainer.checkpoint(header(step, best, elapsed()))?.save(&options.folder.last())?;
            log.save(&options.folder.metrics_csv())?;
        }
        let held = validation.map_or(String::new(), |v| format!("  held-out {:.2} dB, IoU {:.3}", v.psnr, v.mask_iou));
        observer.progress(step, &format!("loss {:.4}  IoU {:.3}{held}", report.loss, report.mask_iou));
        if stop != Stop::Done {
            break;
        }
    }
    let steps = trainer.steps_done();
    let checkpoint = if stop == Stop::Interrupted || best.is_none() {
        trainer.checkpoint(header(steps, best, elapsed()))?
    } else {
        options.folder.load()?
    };
    Ok(Trained { checkpoint, stop, steps, seconds: elapsed(), validation })
}

/// Agreement with the held-out views on a fixed subset of their pixels.
fn validate(trainer: &Trainer<Decoder>) -> Option<Agreement> {
    let march = MarchSettings { steps: 64, ..MarchSettings::default() };
    let settings = RenderSettings { march, ..RenderSettings::default() };
    let field = trainer.frozen();
    let shader = FieldShader::new(&field, settings, trainer.bound());
    agreement(&shader, &trainer.views().held_out, VALIDATION_PIXELS)
}

/// The decoder of a checkpoint, without gradient tracking.
///
/// # Errors
/// When the parameters do not fit the configuration.
pub fn decoder_of(checkpoint: &Checkpoint, device: &Device) -> Result<Decoder> {
    checkpoint.restore_model(checkpoint.header.config.model.init(device)).map(|decoder| decoder.valid())
}
