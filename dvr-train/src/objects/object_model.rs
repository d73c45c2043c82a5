//! A trained model of many objects, whatever it makes of a picture.

use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::dataset::InputPicture;
use dvr_core::number_range::OutOfRange;
use dvr_model::{EncoderConfig, RecordError, save_safetensors};
use dvr_render::extract::ExtractSettings;

use super::config::ObjectsConfig;
use super::model::{Asked, FieldsModel};
use super::shape::Shape;
use super::systems::config::SystemConfig;
use super::systems::model::SystemModel;
use crate::error::{Error, Result};
use crate::run::checkpoint::Checkpoint;

/// A trained model of many objects.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one at a time")]
pub enum ObjectModel {
    /// Makes fields: DVR, and Occupancy Networks.
    Fields(FieldsModel),
    /// Makes whole shapes: a system that DVR is compared with.
    System(SystemModel),
}

impl ObjectModel {
    /// The model that a checkpoint holds.
    ///
    /// # Errors
    /// When it is that of a single scene, or its parameters are damaged.
    pub fn load(checkpoint: &Checkpoint, device: &Device) -> Result<Self> {
        let (record, model) = (&checkpoint.header.method, &checkpoint.state.model);
        if let Some(config) = SystemConfig::of_record(record)? {
            return Ok(Self::System(SystemModel::from_bytes(config, model, device)?));
        }
        let config = ObjectsConfig::of_record(record)?.ok_or(Error::OneScene)?;
        Ok(Self::Fields(FieldsModel::from_bytes(config, model, device)?))
    }

    /// The same with its surface at another occupancy than in its training, between 0 and 1: a lower one takes in what is less
    /// certain, as thin parts are.
    ///
    /// # Errors
    /// When its shapes have no occupancies, or the threshold is none.
    pub fn with_threshold(self, threshold: f64) -> Result<Self> {
        if !(threshold > 0.0 && threshold < 1.0) {
            return Err(OutOfRange::new("threshold", threshold, "above 0 and below 1").into());
        }
        match self {
            Self::Fields(model) => Ok(Self::Fields(model.with_threshold(threshold))),
            Self::System(model) => Ok(Self::System(model.with_threshold(threshold)?)),
        }
    }

    /// The same that takes objects for their own mirror images, or does not, whatever its training found.
    ///
    /// # Errors
    /// When it has learned nothing of a mirror.
    pub fn with_symmetry(self, is_symmetric: bool) -> Result<Self> {
        match self {
            Self::Fields(model) => Ok(Self::Fields(model.with_symmetry(is_symmetric)?)),
            Self::System(_) if is_symmetric => Err(Error::NoMirror),
            system @ Self::System(_) => Ok(system),
        }
    }

    /// What makes the codes.
    pub fn encoder(&self) -> &EncoderConfig {
        match self {
            Self::Fields(model) => &model.config().encoder,
            Self::System(model) => &model.config().encoder,
        }
    }

    /// Side of the pictures that the encoder takes, in pixels; `None` where it knows objects by their number alone.
    pub fn image_size(&self) -> Option<usize> {
        self.encoder().image_size()
    }

    /// The same for callers that have pictures.
    ///
    /// # Errors
    /// When the model takes none.
    pub fn picture_size(&self) -> Result<usize> {
        self.image_size().ok_or(Error::TakesNoPictures)
    }

    /// Numbers that encoder and decoder consist of.
    pub fn parameters(&self) -> usize {
        match self {
            Self::Fields(model) => model.model().num_params(),
            Self::System(model) => model.model().num_params(),
        }
    }

    /// The shape of the object in a picture as [`dvr_core::dataset::input_picture`] makes them.
    ///
    /// # Errors
    /// When a surface needs more memory than there is.
    pub fn shape_of_picture(&self, picture: &InputPicture, extraction: &ExtractSettings) -> Result<Shape> {
        match self {
            Self::Fields(model) => model.shape(Asked::Picture(picture), extraction),
            Self::System(model) => Ok(model.shape(Some(picture), 0, extraction)),
        }
    }

    /// The shape of a training object, given its place among them: for models without pictures.
    ///
    /// # Errors
    /// When a surface needs more memory than there is.
    pub fn shape_of_row(&self, row: usize, extraction: &ExtractSettings) -> Result<Shape> {
        match self {
            Self::Fields(model) => model.shape(Asked::Row(row), extraction),
            Self::System(model) => Ok(model.shape(None, row as i64, extraction)),
        }
    }

    /// Writes encoder and decoder as safetensors.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn save_network(&self, path: &Path) -> std::result::Result<(), RecordError> {
        match self {
            Self::Fields(model) => save_safetensors(path, model.model(), &model.config().image_model()),
            Self::System(model) => save_safetensors(path, model.model(), &model.config().model()),
        }
    }
}
