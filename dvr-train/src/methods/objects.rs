//! One network for many objects, each given by a picture (DVR, section 4.2).

use std::ops::RangeInclusive;

use burn::tensor::Device;
use dvr_core::Supervision;
use dvr_model::EncoderConfig;
use serde_json::Value;

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::learners::learner::Learner;
use crate::methods::memory_estimate::objects_step_bytes;
use crate::methods::method::{Method, ObjectsTraining, Schedule, Start};
use crate::methods::record::CommonSettings;
use crate::methods::trained_model::TrainedModel;
use crate::objects::config::ObjectsConfig;

/// A method that learns from a dataset of objects; [`crate::train_objects`] takes it through a run.
#[derive(Clone, Debug)]
pub struct ObjectsMethod {
    name: &'static str,
    config: ObjectsConfig,
}

/// The method with its defaults: of a size that two cores can train.
pub fn objects(supervision: Supervision) -> ObjectsMethod {
    ObjectsMethod { name: "objects", config: ObjectsConfig::new(supervision) }
}

/// The same with the paper's settings.
pub fn objects_classic(supervision: Supervision) -> ObjectsMethod {
    ObjectsMethod { name: "objects-classic", config: ObjectsConfig::classic(supervision) }
}

/// Occupancy Networks (Mescheder et al. 2019): DVR's decoder with 3D supervision.
pub fn onet() -> ObjectsMethod {
    ObjectsMethod { name: "onet", config: ObjectsConfig::new(Supervision::Occupancy) }
}

impl ObjectsMethod {
    /// The paper's, with a configuration of one's own.
    pub(crate) fn classic(config: ObjectsConfig) -> Self {
        Self { name: "objects-classic", config }
    }

    /// With a configuration of one's own.
    pub fn new(config: ObjectsConfig) -> Self {
        Self { name: "objects", config }
    }
}

/// Why a model of many objects is no field by itself.
pub(crate) fn no_field_alone(encoder: &EncoderConfig) -> Error {
    match encoder {
        EncoderConfig::Codes { objects } => Error::ChooseObject { objects: *objects },
        _ => Error::NeedsPicture,
    }
}

impl Method for ObjectsMethod {
    fn name(&self) -> &str {
        self.name
    }

    fn config(&self) -> Result<Value> {
        self.config.to_value()
    }

    fn common(&self) -> CommonSettings {
        let TrainConfig { supervision, seed, steps, .. } = self.config.train;
        CommonSettings { supervision, seed, steps, hold_out_every: 0 }
    }

    fn with_overrides(&self, overrides: &Value) -> Result<Box<dyn Method>> {
        Ok(Box::new(Self { name: self.name, config: self.config.overridden(overrides)? }))
    }

    fn check(&self) -> Result<()> {
        self.config.check()
    }

    fn schedule(&self) -> Schedule {
        let TrainConfig { validate_every, checkpoint_every, .. } = self.config.train;
        Schedule { validate_every, checkpoint_every, best: Some(|found| found.mask_iou) }
    }

    fn takes_more_steps(&self) -> bool {
        true
    }

    fn start<'a>(&self, _: Start<'a, '_>) -> Result<Box<dyn Learner + 'a>> {
        Err(Error::NeedsObjects { method: self.name.to_owned() })
    }

    fn load(&self, _: &[u8], _: &Device) -> Result<Box<dyn TrainedModel>> {
        Err(no_field_alone(&self.config.encoder))
    }

    fn rays(&self) -> Option<RangeInclusive<usize>> {
        let train = &self.config.train;
        let has_rays = train.supervision != Supervision::Occupancy;
        has_rays.then(|| train.sampling().patch_pixels()..=train.rays)
    }

    fn memory_estimate(&self, rays: Option<usize>) -> u64 {
        let mut config = self.config.clone();
        config.train.rays = rays.unwrap_or(config.train.rays);
        objects_step_bytes(&config)
    }

    fn objects(&self) -> Option<ObjectsTraining<'_>> {
        Some(ObjectsTraining::Fields(&self.config))
    }
}
