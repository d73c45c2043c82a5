//! What is evaluated on a dataset: anything that makes a shape of a picture.

use dvr_core::dataset::ObjectDataset;
use dvr_core::inside::points_inside;
use dvr_core::mesh::Mesh;
use dvr_core::metrics::shape::SURFACE_SAMPLES;
use dvr_core::sampling::sample_surface;
use dvr_core::{GroundTruth, OccupancySamples, PointCloud, Split};
use dvr_render::extract::{ExtractSettings, FieldSurface};
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::draw::stable_hash;
use super::mean_shape::MeanShapes;
use super::model::ObjectModel;
use super::nearest_picture::NearestPicture;
use crate::error::{Error, Result};
use crate::evaluate::{ShapeEvaluation, evaluate_points};
use crate::export::mesh::{ColorSource, MeshOptions, object_mesh};

/// What makes shapes.
pub enum Predictor {
    /// A trained model.
    Model(Box<ObjectModel>),
    /// The mean training shape of the object's category, whatever the picture: what can be had without looking.
    MeanShape(MeanShapes),
    /// The training object with the most similar picture: what can be had by remembering.
    NearestPicture(NearestPicture),
}

/// A shape in object space.
pub enum Shape {
    /// A surface; empty where the predictor sees none.
    Mesh(Mesh),
    /// Another object, as its dataset describes it.
    Samples(GroundTruth),
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
            Self::Model(model) => {
                let field = match model.image_size() {
                    Some(size) => model.field_of_picture(&dataset.read_input(object, input, size as u32)?),
                    None => model.field_of_row(training_row(dataset, object)?),
                };
                let options = MeshOptions {
                    extraction: extraction.clone(),
                    colors: ColorSource::Field,
                    ..MeshOptions::default()
                };
                match object_mesh(&FieldSurface::new(&field), &options, &[], &[]) {
                    Ok(extracted) => Ok(Shape::Mesh(extracted.mesh)),
                    Err(Error::NoMesh(_)) => Ok(Shape::Mesh(Mesh::default())),
                    Err(other) => Err(other),
                }
            }
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

impl Shape {
    /// Scores the shape against the truth.
    ///
    /// # Errors
    /// When the truth, or the shape, has points that are not finite.
    pub fn evaluate(&self, truth: &GroundTruth, seed: u64) -> Result<ShapeEvaluation> {
        match self {
            Self::Mesh(mesh) => {
                let sampled = || PointCloud::from(sample_surface(mesh, SURFACE_SAMPLES, seed));
                evaluate_points(sampled, |points| points_inside(mesh, points), truth, seed)
            }
            Self::Samples(samples) => {
                let surface = || samples.surface.clone().unwrap_or_default();
                let inside = |points: &[Vec3]| inside_nearest(samples.occupancy.as_ref(), points);
                evaluate_points(surface, inside, truth, seed)
            }
        }
    }
}

/// Whether the nearest sample to each point is inside; false without samples.
fn inside_nearest(samples: Option<&OccupancySamples>, points: &[Vec3]) -> Vec<bool> {
    let nothing = || vec![false; points.len()];
    let Some(samples) = samples else { return nothing() };
    let positions: Vec<[f64; 3]> = samples.points.iter().map(|point| point.as_dvec3().to_array()).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions) else { return nothing() };
    points
        .iter()
        .map(|point| {
            let query = point.as_dvec3().to_array();
            samples.inside[tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute().item as usize]
        })
        .collect()
}
