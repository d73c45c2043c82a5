//! The loop of a run: steps, validations, checkpoints, until all is done or somebody says stop.

use std::time::Instant;

use dvr_core::PointCloud;
use dvr_render::{ViewMetrics, memory_excess};

use super::best::Best;
use super::chamfer_curve::ChamferCurve;
use super::checkpoint::{Checkpoint, CheckpointHeader};
use super::metrics_log::MetricsLog;
use super::options::{RunOptions, RunOutcome, Stop};
use crate::error::{Error, Result};
use crate::learners::learner::Learner;
use crate::learners::step_report::{READ_EVERY, StepReport};
use crate::methods::method::{Method, Schedule};
use crate::observer::Observer;
use crate::resources::Resources;

/// Steps between rows of `metrics.csv`.
const LOG_EVERY: usize = READ_EVERY;

/// Pixels that a validation during training looks at: with fewer, its noise would choose the best checkpoint.
const VALIDATION_PIXELS: usize = 8192;

/// A run that is under way.
pub(crate) struct TrainingLoop<'r> {
    method: &'r dyn Method,
    schedule: Schedule,
    options: &'r RunOptions,
    start: Instant,
    /// Wall seconds of earlier sessions.
    seconds_before: f64,
    /// What the next checkpoint says, but for its step and time.
    header: CheckpointHeader,
    log: MetricsLog,
    curve: Option<ChamferCurve<'r>>,
    /// Header and model of the best step of this session.
    best: Option<(CheckpointHeader, Vec<u8>)>,
    validation: Option<ViewMetrics>,
}

impl<'r> TrainingLoop<'r> {
    /// A run that began at `start`; `header` is that of its checkpoints.
    pub fn new(method: &'r dyn Method, header: CheckpointHeader, options: &'r RunOptions, start: Instant) -> Self {
        Self {
            method,
            schedule: method.schedule(),
            options,
            start,
            seconds_before: 0.0,
            header,
            log: MetricsLog::default(),
            curve: None,
            best: None,
            validation: None,
        }
    }

    /// Compares the shape with its truth at each validation, where that is known.
    pub fn following(self, truth: Option<&'r PointCloud>) -> Self {
        Self { curve: truth.map(|truth| ChamferCurve::new(truth, self.options.device.clone())), ..self }
    }

    /// Trains to the end.
    pub fn run(
        mut self,
        learner: &mut dyn Learner,
        resume_from: Option<&Checkpoint>,
        observer: &mut dyn Observer,
    ) -> Result<RunOutcome> {
        // Every step is worth a checkpoint.
        let _shield = self.options.cancellation.shield();
        if let Some(Checkpoint { header, state }) = resume_from {
            learner.resume(state, header.step)?;
            self.log = MetricsLog::resume(&self.options.folder.metrics_csv(), header.step)?;
            (self.header.best, self.seconds_before) = (header.best, header.seconds);
            // Results of a run that has come to its end stand until they are made again.
            if learner.steps_done() < learner.total_steps() {
                self.options.folder.forget_view_color()?;
            }
        }
        let mut announced = learner.total_steps();
        observer.phase("training", announced);
        let mut stop = Stop::Done;
        while learner.steps_done() < learner.total_steps() {
            let report = learner.step()?;
            self.tell(learner, observer);
            stop = self.stop();
            self.after_step(learner, &report, stop)?;
            // A pass more, or finer cells that are not worth it.
            if announced != learner.total_steps() {
                announced = learner.total_steps();
                observer.phase("training", announced);
            }
            observer.progress(report.step, &self.message(&report));
            if stop != Stop::Done {
                break;
            }
            self.check_memory(learner, report.step)?;
        }
        // What a run of no steps found.
        self.tell(learner, observer);
        self.outcome(learner, stop)
    }

    /// Says what the learner has to say, and keeps it.
    fn tell(&mut self, learner: &mut dyn Learner, observer: &mut dyn Observer) {
        let notes = learner.notes();
        notes.iter().for_each(|note| observer.note(note));
        self.header.notes.extend(notes);
    }

    /// Wall seconds of training so far; the clock stands still while the shape is compared with the truth.
    fn elapsed(&self) -> f64 {
        self.seconds_before + self.start.elapsed().as_secs_f64() - self.measuring()[0]
    }

    /// Wall and CPU seconds of comparing the shape.
    fn measuring(&self) -> [f64; 2] {
        self.curve.as_ref().map_or([0.0; 2], ChamferCurve::spent)
    }

    /// Whether somebody or the clock ends the run.
    fn stop(&self) -> Stop {
        let Self { options, .. } = self;
        match () {
            () if options.cancellation.is_cancelled() => Stop::Interrupted,
            () if options.time_limit.is_some_and(|limit| self.elapsed() >= limit.as_secs_f64()) => Stop::TimeLimit,
            () => Stop::Done,
        }
    }

    /// Validates, logs and stores, as far as it is time for that.
    fn after_step(&mut self, learner: &dyn Learner, report: &StepReport, stop: Stop) -> Result<()> {
        let step = report.step;
        let ending = step >= learner.total_steps() || stop != Stop::Done;
        let validate_now = step.is_multiple_of(self.schedule.validate_every) || (ending && stop != Stop::Interrupted);
        if validate_now {
            self.validation = learner.validate(VALIDATION_PIXELS);
        }
        if validate_now || step.is_multiple_of(LOG_EVERY) {
            self.add_row(learner, report, validate_now)?;
        }
        // The best checkpoint is never ahead of the last: a resumed run must not end with one of its own future.
        let is_best = validate_now && self.keep_best(learner, step)?;
        if ending || is_best || step.is_multiple_of(self.schedule.checkpoint_every) {
            self.save(learner)?;
        }
        Ok(())
    }

    /// Adds a row to the curves.
    fn add_row(&mut self, learner: &dyn Learner, report: &StepReport, is_validated: bool) -> Result<()> {
        let spent = [self.elapsed(), Resources::now().cpu_seconds - self.measuring()[1]];
        let chamfer = match &mut self.curve {
            Some(curve) if is_validated => Some(curve.chamfer_l1(self.method, learner)?),
            _ => None,
        };
        self.log.push(report, spent, self.validation.as_ref().filter(|_| is_validated), chamfer);
        Ok(())
    }

    /// Stores the step if its validation is better than all before; returns whether it is.
    fn keep_best(&mut self, learner: &dyn Learner, step: usize) -> Result<bool> {
        let (Some(figure), Some(found)) = (self.schedule.best, &self.validation) else { return Ok(false) };
        let found = Best { step, psnr: found.psnr, mask_iou: found.mask_iou };
        let is_best = self.header.best.is_none_or(|best| figure(&found) > figure(&best));
        if is_best {
            self.header.best = Some(found);
            let checkpoint = self.checkpoint(learner)?;
            checkpoint.save(&self.options.folder.best())?;
            self.best = Some((checkpoint.header, checkpoint.state.model));
        }
        Ok(is_best)
    }

    /// The checkpoint of this moment.
    fn checkpoint(&self, learner: &dyn Learner) -> Result<Checkpoint> {
        let header = self.header_now(learner, self.elapsed());
        Ok(Checkpoint { header, state: learner.state()? })
    }

    /// The header of this moment.
    fn header_now(&self, learner: &dyn Learner, seconds: f64) -> CheckpointHeader {
        let exposures = learner.exposures();
        CheckpointHeader { step: learner.steps_done(), seconds, exposures, ..self.header.clone() }
    }

    /// Stores the curves and the last checkpoint: killed in between, a run has more rows than steps, which resuming drops.
    fn save(&self, learner: &dyn Learner) -> Result<()> {
        self.log.save(&self.options.folder.metrics_csv())?;
        self.checkpoint(learner)?.save(&self.options.folder.last())
    }

    /// A line for people.
    fn message(&self, report: &StepReport) -> String {
        let found = self.validation.as_ref();
        let found = found.map_or(String::new(), |v| format!("  validation {:.2} dB, IoU {:.3}", v.psnr, v.mask_iou));
        let iou = if report.mask_iou.is_nan() { String::new() } else { format!("  IoU {:.3}", report.mask_iou) };
        format!("loss {:.4}{iou}{found}", report.loss)
    }

    /// Ends a run that holds more of a GPU's memory than it may.
    fn check_memory(&self, learner: &dyn Learner, step: usize) -> Result<()> {
        if step.is_multiple_of(READ_EVERY)
            && let Some((bytes, allowed)) = memory_excess(&self.options.device)
        {
            self.save(learner)?;
            return Err(Error::HeldMemory { step, bytes, allowed });
        }
        Ok(())
    }

    /// What stands for the run: the best step, or the last where nothing was validated or somebody interrupted.
    fn outcome(mut self, learner: &dyn Learner, stop: Stop) -> Result<RunOutcome> {
        let (steps, seconds) = (learner.steps_done(), self.elapsed());
        if steps == 0 {
            self.checkpoint(learner)?.save(&self.options.folder.last())?;
        }
        let (header, model) = match self.best.take() {
            Some(best) if stop != Stop::Interrupted => best,
            // Of an earlier session.
            None if stop != Stop::Interrupted && self.header.best.is_some() => {
                let Checkpoint { header, state } = Checkpoint::load(&self.options.folder.best())?;
                (header, state.model)
            }
            _ => (self.header_now(learner, seconds), learner.model()?),
        };
        let measuring_seconds = self.measuring();
        let (validation, stereo_depths) = (self.validation, learner.stereo_depths());
        Ok(RunOutcome { header, model, stop, steps, seconds, measuring_seconds, validation, stereo_depths })
    }
}
