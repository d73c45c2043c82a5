//! A training run from start to end: folder, checkpoints, validation, and what is written when it is over.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::time::Instant;

use dvr_core::Scene;
use dvr_model::Decoder;
use dvr_render::memory_excess;

use crate::cameras::RefinedCameras;
use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::learners::learner::Learner;
use crate::learners::sparse::SparseTargets;
use crate::learners::trainer::{READ_EVERY, Trainer};
use crate::learners::warm_start::{carve_hull, hull_bound, warm_start};
use crate::methods::memory_estimate::too_much_memory;
use crate::methods::method::Method;
use crate::observer::Observer;
use crate::resources::Resources;
use crate::run::chamfer_curve::ChamferCurve;
use crate::run::checkpoint::{Best, CHECKPOINT_VERSION, Checkpoint, CheckpointHeader};
use crate::run::metrics_log::MetricsLog;
use crate::run::options::{RunOptions, Stop, Trained};
use dvr_core::ViewSplit;
use dvr_grid::GridTrainer;

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
