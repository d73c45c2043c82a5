//! What is evaluated on a dataset: anything that makes a shape of a picture.

use dvr_core::Split;
use dvr_core::dataset::ObjectDataset;
use dvr_render::extract::ExtractSettings;

use super::draw::stable_hash;
use super::mean_shape::MeanShapes;
use super::nearest_picture::NearestPicture;
use super::object_model::ObjectModel;
use super::shape::Shape;
use crate::error::{Error, Result};

/// What makes shapes.
pub enum Predictor {
    /// A trained model.
    Model(Box<ObjectModel>),
    /// The mean training shape of the object's category, whatever the picture: what can be had without looking.
    MeanShape(MeanShapes),
    /// The training object with the most similar picture: what can be had by remembering.
    NearestPicture(NearestPicture),
}

impl Predictor {
    /// The shape of an object, made of its picture number `input`.
    ///
    /// # Errors
    /// Where the object's files are missing or damaged, or it has no place in what the predictor knows.
    pub fn shape(
        &self,
        dataset: &ObjectDataset,
        object: usize,
        input: usize,
        extraction: &ExtractSettings,
    ) -> Result<Shape> {
        match self {
            Self::Model(model) => match model.image_size() {
                Some(size) => model.shape_of_picture(&dataset.read_input(object, input, size as u32)?, extraction),
                None => model.shape_of_row(training_row(dataset, object)?, extraction),
            },
            Self::MeanShape(means) => Ok(Shape::Mesh(means.of(&dataset.objects()[object].category, extraction)?)),
            Self::NearestPicture(nearest) => {
                let nearest = nearest.find(dataset, object, input)?;
                Ok(Shape::Samples(dataset.read_ground_truth(nearest)?))
            }
        }
    }
}

impl Predictor {
    /// The object whose files the shape of another is taken from, where that is so.
    ///
    /// # Errors
    /// Where the object's picture cannot be read.
    pub fn other_object(&self, dataset: &ObjectDataset, object: usize, seed: u64) -> Result<Option<usize>> {
        match self {
            Self::NearestPicture(nearest) => {
                nearest.find(dataset, object, evaluated_input(dataset, object, seed)?).map(Some)
            }
            Self::Model(_) | Self::MeanShape(_) => Ok(None),
        }
    }
}

/// The picture by which an object is measured: chosen by a hash, the same for every predictor.
///
/// # Errors
/// Where the object has no pictures.
pub fn evaluated_input(dataset: &ObjectDataset, object: usize, seed: u64) -> Result<usize> {
    let name = &dataset.objects()[object];
    let inputs = dataset.inputs(object)? as u64;
    Ok((stable_hash(seed, &[&name.category, &name.name]) % inputs) as usize)
}

/// The place of an object among the training objects.
fn training_row(dataset: &ObjectDataset, object: usize) -> Result<usize> {
    let row = dataset.of_split(Split::Train).iter().position(|&other| other == object);
    row.ok_or(Error::NotATrainingObject)
}
