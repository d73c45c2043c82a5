//! A training run from start to end: folder, checkpoints, validation, and what is written when it is over.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use burn::tensor::Device;
use dvr_core::{PointCloud, Scene};
use dvr_model::Decoder;
use dvr_render::memory_excess;

use crate::cameras::RefinedCameras;
use crate::chamfer_curve::ChamferCurve;
use crate::checkpoint::{Best, CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::learner::Learner;
use crate::memory_estimate::too_much_memory;
use crate::method::Method;
use crate::metrics_log::MetricsLog;
use crate::resources::Resources;
use crate::sparse::SparseTargets;
use crate::trainer::{READ_EVERY, Trainer};
use crate::warm_start::{carve_hull, hull_bound, warm_start};
use dvr_core::ViewSplit;
use dvr_grid::GridTrainer;
use dvr_render::ViewMetrics;

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

    /// The field alone, compact: for grid fields.
    pub fn scene_file(&self) -> PathBuf {
        self.root.join("scene.dvr")
    }

    /// The refined cameras, as nerfstudio's `transforms.json`, in the scene's own coordinates.
    pub fn cameras(&self) -> PathBuf {
        self.root.join("cameras.json")
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

    /// The report, a page for a browser.
    pub fn report(&self) -> PathBuf {
        self.root.join("report.html")
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
            self.scene_file(),
            self.cameras(),
            self.config(),
            self.metrics_csv(),
            self.metrics_json(),
            self.mesh_ply(),
            self.mesh_glb(),
            self.preview(),
            self.report(),
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

/// Nobody listens.
impl Observer for () {
    fn phase(&mut self, _: &str, _: usize) {}
    fn progress(&mut self, _: usize, _: &str) {}
    fn note(&mut self, _: &str) {}
}

/// How a run is carried out, besides its configuration.
pub struct RunOptions<'a> {
    /// The folder.
    pub folder: RunFolder,
    /// The device, without autodiff.
    pub device: Device,
    /// Devices that share each step of a network with it, without autodiff too.
    pub helpers: Vec<Device>,
    /// How the scene was read; stored in checkpoints.
    pub reading: serde_json::Value,
    /// Wall time after which training stops as if its steps were done.
    pub time_limit: Option<Duration>,
    /// What became of the scene's cameras, where they were refined.
    pub refined: Option<RefinedCameras>,
    /// The true surface, with which the shape is compared at each validation, beside the clock: a column of
    /// `metrics.csv`. It teaches nothing.
    pub truth: Option<&'a PointCloud>,
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
    /// Wall and CPU seconds of this session that went into comparing the shape with the truth; they are not in
    /// `seconds`.
    pub measuring_seconds: [f64; 2],
    /// The last validation.
    pub validation: Option<ViewMetrics>,
}

/// Steps between rows of `metrics.csv`.
const LOG_EVERY: usize = READ_EVERY;

/// Pixels that a validation during training looks at: with fewer, its noise would choose the best checkpoint.
const VALIDATION_PIXELS: usize = 8192;

/// Reconstructs a scene from where `resume_from` left it, or from the start.
///
/// # Errors
/// When the scene has too few views, a file cannot be written, or the loss diverges.
pub fn train(
    scene: &Scene,
    method: Method,
    resume_from: Option<&Checkpoint>,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<Trained> {
    method.check()?;
    scene.require_masks()?;
    let start = Instant::now();
    let views = ViewSplit::new(scene, method.hold_out_every())?;
    let held_out: Vec<String> = views.held_out.iter().map(|view| view.name.clone()).collect();
    let cameras = match (resume_from, &options.refined) {
        (Some(checkpoint), _) => checkpoint.header.cameras.clone(),
        (None, Some(refined)) => refined.cameras.clone(),
        (None, None) => BTreeMap::new(),
    };
    let header = |step, best, seconds| CheckpointHeader {
        version: CHECKPOINT_VERSION,
        method: method.clone(),
        step,
        seconds,
        best,
        scene: scene.source.clone(),
        reading: options.reading.clone(),
        object_to_world: scene.object_to_world,
        held_out: held_out.clone(),
        cameras: cameras.clone(),
        notes: Vec::new(),
    };
    match &method {
        Method::Grid(config) => {
            if !options.helpers.is_empty() {
                return Err(Error::Config("fields on grids train on one device: only networks share steps".into()));
            }
            observer.phase("measuring the masks", 1);
            let mut learner = GridTrainer::new(views, config.clone())?.on(&options.device)?;
            let pace = Pace { validate_every: 100, checkpoint_every: 500, best: None };
            carry_out(&mut learner, pace, start, &header, resume_from, options, observer)
        }
        Method::Objects(_) => {
            Err(Error::Config("this method learns from a dataset of objects, not from a scene".into()))
        }
        Method::Network(config) => {
            let mut learner = network(scene, views, config, resume_from.is_some(), options, observer)?;
            let TrainConfig { validate_every, checkpoint_every, .. } = *config;
            let pace = Pace { validate_every, checkpoint_every, best: Some(|found| found.psnr) };
            carry_out(&mut learner, pace, start, &header, resume_from, options, observer)
        }
    }
}

/// A network in training, warmed up by the hull unless its parameters come from a checkpoint.
fn network<'a>(
    scene: &'a Scene,
    views: ViewSplit<'a>,
    config: &TrainConfig,
    resumed: bool,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<Trainer<'a, Decoder>> {
    options.device.seed(config.seed);
    let mut field = config.model.init(&options.device.clone().autodiff());
    let hull = carve_hull(&views.train, config.hull.resolution)?;
    if hull.is_empty() {
        observer.note("the masks have no visual hull in common: training starts from noise (see `dvr info`)");
    }
    if !resumed && !hull.is_empty() && config.hull.warm_start_steps > 0 {
        observer.phase("fitting the visual hull", config.hull.warm_start_steps);
        let progress = |done| observer.progress(done, "");
        field = warm_start(field, &hull, config, &options.device, options.interrupted, progress);
    }
    let bound = if config.hull.bound_rays { hull_bound(&hull) } else { None };
    let sparse = SparseTargets::new(scene, &views.train);
    let trainer = Trainer::new(field, views, config.clone(), options.device.clone());
    Ok(trainer.with_helpers(options.helpers.clone()).with_bound(bound).with_sparse_targets(sparse))
}

/// How often a run looks up.
#[derive(Clone, Copy)]
pub(crate) struct Pace {
    /// Steps between validations.
    pub validate_every: usize,
    /// Steps between checkpoints.
    pub checkpoint_every: usize,
    /// The figure by which the best step is chosen to stand for the run; without one, the last step does.
    pub best: Option<fn(&Best) -> f64>,
}

/// The loop: steps, validations, checkpoints, until all is done or somebody says stop.
pub(crate) fn carry_out(
    learner: &mut dyn Learner,
    pace: Pace,
    start: Instant,
    header: &dyn Fn(usize, Option<Best>, f64) -> CheckpointHeader,
    resume_from: Option<&Checkpoint>,
    options: &RunOptions,
    observer: &mut dyn Observer,
) -> Result<Trained> {
    let before = resume_from.map_or(0.0, |checkpoint| checkpoint.header.seconds);
    let mut course = options.truth.map(|truth| ChamferCurve::new(truth, options.device.clone()));
    // What comparing the shape with the truth has taken, wall and CPU: the clock stands still meanwhile.
    let measuring = Cell::new([0.0; 2]);
    let elapsed = || before + start.elapsed().as_secs_f64() - measuring.get()[0];
    let mut log = MetricsLog::default();
    let mut best = None;
    let mut notes: Vec<String> = options.refined.iter().map(RefinedCameras::note).collect();
    if let Some(checkpoint) = resume_from {
        learner.resume(&checkpoint.state, checkpoint.header.step)?;
        log = MetricsLog::resume(&options.folder.metrics_csv(), checkpoint.header.step)?;
        best = checkpoint.header.best;
        notes.clone_from(&checkpoint.header.notes);
    }
    let checkpoint = |learner: &dyn Learner, best, notes: &[String]| -> Result<Checkpoint> {
        let header = header(learner.steps_done(), best, elapsed());
        Ok(Checkpoint { header: CheckpointHeader { notes: notes.to_vec(), ..header }, state: learner.state()? })
    };

    observer.phase("training", learner.total_steps());
    let mut stop = Stop::Done;
    let mut validation = None;
    while learner.steps_done() < learner.total_steps() {
        let report = learner.step()?;
        let step = report.step;
        let said = learner.notes();
        said.iter().for_each(|note| observer.note(note));
        notes.extend(said);
        stop = match () {
            () if options.interrupted.load(Ordering::Relaxed) => Stop::Interrupted,
            () if options.time_limit.is_some_and(|limit| elapsed() >= limit.as_secs_f64()) => Stop::TimeLimit,
            () => Stop::Done,
        };
        let ending = step >= learner.total_steps() || stop != Stop::Done;
        let validate_now = step % pace.validate_every == 0 || (ending && stop != Stop::Interrupted);
        if validate_now {
            validation = learner.validate(VALIDATION_PIXELS);
        }
        if step % LOG_EVERY == 0 || validate_now {
            let spent = [elapsed(), Resources::now().cpu_seconds - measuring.get()[1]];
            let mut chamfer = None;
            if let (true, Some(course)) = (validate_now, &mut course) {
                chamfer = Some(course.chamfer_l1(&checkpoint(learner, best, &notes)?)?);
                measuring.set(course.spent());
            }
            log.push(&report, spent, validation.as_ref().filter(|_| validate_now), chamfer);
        }
        let found = validation.filter(|_| validate_now);
        let found = found.map(|found| Best { step, psnr: found.psnr, mask_iou: found.mask_iou });
        if let (Some(found), Some(figure)) = (found, pace.best)
            && best.is_none_or(|best| figure(&found) > figure(&best))
        {
            best = Some(found);
            checkpoint(learner, best, &notes)?.save(&options.folder.best())?;
        }
        if ending || step % pace.checkpoint_every == 0 {
            checkpoint(learner, best, &notes)?.save(&options.folder.last())?;
            log.save(&options.folder.metrics_csv())?;
        }
        let held = validation.map_or(String::new(), |v| format!("  held-out {:.2} dB, IoU {:.3}", v.psnr, v.mask_iou));
        observer.progress(step, &format!("loss {:.4}  IoU {:.3}{held}", report.loss, report.mask_iou));
        if stop != Stop::Done {
            break;
        }
        if step % READ_EVERY == 0
            && let Some((bytes, allowed)) = memory_excess(&options.device)
        {
            checkpoint(learner, best, &notes)?.save(&options.folder.last())?;
            log.save(&options.folder.metrics_csv())?;
            return Err(too_much_memory(step, bytes, allowed));
        }
    }
    let steps = learner.steps_done();
    let seconds = elapsed();
    if steps == 0 {
        checkpoint(learner, best, &notes)?.save(&options.folder.last())?;
    }
    let checkpoint =
        if stop == Stop::Interrupted { Checkpoint::load(&options.folder.last())? } else { options.folder.load()? };
    Ok(Trained { checkpoint, stop, steps, seconds, measuring_seconds: measuring.get(), validation })
}
