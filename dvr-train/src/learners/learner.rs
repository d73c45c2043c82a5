//! What a run needs of whatever it trains.

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::{ModuleRecord, RecordError};
use burn::tensor::Bytes;
use dvr_grid::GridTrainer;
use dvr_model::Decoder;
use dvr_render::{FieldShader, MarchSettings, RenderSettings};

use crate::error::{Error, Result};
use crate::learners::trainer::{StepReport, Trainer};
use crate::run::checkpoint::LearnerState;
use dvr_render::{ViewMetrics, view_metrics};

/// A field in training, as a run sees it.
pub trait Learner {
    /// One step.
    ///
    /// # Errors
    /// When the loss is no number.
    fn step(&mut self) -> Result<StepReport>;

    /// Steps done so far.
    fn steps_done(&self) -> usize;

    /// Steps after which training is done. May fall while training goes on, where nothing more is gained.
    fn total_steps(&self) -> usize;

    /// ViewMetrics with held-out views on about so many of their pixels; `None` where none are held out.
    fn validate(&self, pixels: usize) -> Option<ViewMetrics>;

    /// What a checkpoint keeps.
    ///
    /// # Errors
    /// When it cannot be put in bytes.
    fn state(&self) -> Result<LearnerState>;

    /// Goes on where `state` was taken, after so many steps.
    ///
    /// # Errors
    /// When the state is damaged or another configuration's.
    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()>;

    /// What it has to say for people since it was last asked.
    fn notes(&mut self) -> Vec<String> {
        Vec::new()
    }
}

impl Learner for Trainer<'_, Decoder> {
    fn step(&mut self) -> Result<StepReport> {
        self.step()
    }

    fn steps_done(&self) -> usize {
        self.steps_done()
    }

    fn total_steps(&self) -> usize {
        self.config().steps
    }

    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        let march = MarchSettings { steps: 64, ..MarchSettings::default() };
        let settings = RenderSettings { march, ..RenderSettings::default() };
        let field = self.frozen();
        view_metrics(&FieldShader::new(&field, settings, self.bound()), &self.views().held_out, pixels)
    }

    fn state(&self) -> Result<LearnerState> {
        let (field, optimizer) = self.parts();
        module_state(field.clone(), optimizer)
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        let field = restore_module(&state.model, self.parts().0.clone())?;
        let optimizer = restore_optimizer(&state.training, self.parts().1.clone())?;
        self.restore(field, optimizer, steps);
        Ok(())
    }
}

impl Learner for GridTrainer<'_> {
    fn step(&mut self) -> Result<StepReport> {
        let dvr_grid::StepReport { step, loss, terms, mask_iou, learning_rate } = self.step()?;
        Ok(StepReport { step, loss, terms, mask_iou, learning_rate, samples: 0 })
    }

    fn steps_done(&self) -> usize {
        self.steps_done()
    }

    fn total_steps(&self) -> usize {
        self.total_steps()
    }

    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        self.validate(pixels)
    }

    fn state(&self) -> Result<LearnerState> {
        let dvr_grid::TrainerState { model, training } = self.state()?;
        Ok(LearnerState { model, training })
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        let LearnerState { model, training } = state.clone();
        Ok(self.resume(&dvr_grid::TrainerState { model, training }, steps)?)
    }

    fn notes(&mut self) -> Vec<String> {
        self.notes()
    }
}

/// A module and its optimiser as bytes.
pub(crate) fn module_state<M: Module>(module: M, optimizer: &ModuleOptimizer) -> Result<LearnerState> {
    let broken = |e: RecordError| Error::Config(format!("the model cannot be stored: {e}"));
    let model = module.into_record().into_bytes().map_err(broken)?.to_vec();
    let training = optimizer.into_bytes().map_err(broken)?.to_vec();
    Ok(LearnerState { model, training })
}

/// Puts stored parameters into a module.
///
/// # Errors
/// When their names or shapes are not those of the module.
pub(crate) fn restore_module<M: Module>(bytes: &[u8], module: M) -> Result<M> {
    let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(bytes.to_vec()));
    record
        .and_then(|record| module.try_load_record(record))
        .map_err(|e| Error::Config(format!("the checkpoint's parameters do not fit its own configuration: {e}")))
}

/// Puts a stored state into an optimiser.
///
/// # Errors
/// When it cannot be read.
pub(crate) fn restore_optimizer(bytes: &[u8], optimizer: ModuleOptimizer) -> Result<ModuleOptimizer> {
    optimizer
        .from_bytes(Bytes::from_bytes_vec(bytes.to_vec()))
        .map_err(|e| Error::Config(format!("the checkpoint's optimiser state cannot be read: {e}")))
}
