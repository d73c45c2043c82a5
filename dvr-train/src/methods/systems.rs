//! The systems that DVR is compared with, as methods.

use burn::tensor::Device;
use dvr_core::Supervision;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::learners::learner::Learner;
use crate::methods::memory_estimate::system_step_bytes;
use crate::methods::method::{Method, ObjectsTraining, Schedule, Start};
use crate::methods::objects::no_field_alone;
use crate::methods::record::CommonSettings;
use crate::methods::trained_model::TrainedModel;
use crate::objects::systems::config::{System, SystemConfig};

/// A system that DVR is compared with; [`crate::train_objects`] takes it through a run.
#[derive(Clone, Debug)]
pub struct SystemMethod {
    config: SystemConfig,
}

impl SystemMethod {
    /// The system with its defaults.
    pub fn new(system: System, supervision: Supervision) -> Self {
        Self { config: SystemConfig::new(system, supervision) }
    }
}

impl Method for SystemMethod {
    fn name(&self) -> &str {
        self.config.system.name()
    }

    fn config(&self) -> Result<Value> {
        self.config.to_value()
    }

    fn common(&self) -> CommonSettings {
        let SystemConfig { supervision, seed, steps, .. } = self.config;
        CommonSettings { supervision, seed, steps, hold_out_every: 0 }
    }

    fn with_overrides(&self, overrides: &Value) -> Result<Box<dyn Method>> {
        Ok(Box::new(Self { config: self.config.overridden(overrides)? }))
    }

    fn check(&self) -> Result<()> {
        self.config.check()
    }

    fn schedule(&self) -> Schedule {
        let SystemConfig { validate_every, checkpoint_every, .. } = self.config;
        Schedule { validate_every, checkpoint_every, best: Some(|found| found.mask_iou) }
    }

    fn takes_more_steps(&self) -> bool {
        true
    }

    fn start<'a>(&self, _: Start<'a, '_>) -> Result<Box<dyn Learner + 'a>> {
        Err(Error::NeedsObjects { method: self.name().to_owned() })
    }

    fn load(&self, _: &[u8], _: &Device) -> Result<Box<dyn TrainedModel>> {
        Err(match no_field_alone(&self.config.encoder) {
            Error::ChooseObject { .. } => Error::NoField { method: self.name().to_owned() },
            other => other,
        })
    }

    fn memory_estimate(&self, _: Option<usize>) -> u64 {
        system_step_bytes(&self.config)
    }

    fn objects(&self) -> Option<ObjectsTraining<'_>> {
        Some(ObjectsTraining::System(&self.config))
    }
}
