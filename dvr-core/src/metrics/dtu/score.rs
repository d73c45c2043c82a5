//! The figures of a surface.

use glam::{DVec3, Vec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::normals::estimated_normals;
use super::samples::surface_points;
use super::thinning::thinned;
use super::{DENSITY, DtuReference, FARTHEST, MARGIN};
use crate::camera::Similarity;
use crate::error::{ComparisonError, Result};
use crate::mesh::Mesh;
use crate::metrics::alignment::align_to_surface;
use crate::metrics::points::quantile;
use crate::points::PointCloud;

/// Points that an alignment goes by.
const ALIGNED_POINTS: usize = 50_000;

/// How a surface is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DtuSettings {
    /// Whether the surface is brought to the scan before it is measured, by the similarity of iterated closest points
    /// within [`FARTHEST`]: where its cameras are not those of the data set.
    pub align: bool,
    /// Seed of the order in which points are left out.
    pub seed: u64,
}

/// Distances in one direction, in millimetres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DtuDistances {
    /// Points that were measured from.
    pub points: usize,
    /// Of these, those that are [`FARTHEST`] or more away, which do not count.
    pub beyond: usize,
    /// Mean of those that count.
    pub mean: f64,
    /// Median of those that count.
    pub median: f64,
}

/// The figures of the protocol, in millimetres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DtuScore {
    /// From the surface to the scan.
    pub accuracy: DtuDistances,
    /// From the scan to the surface.
    pub completeness: DtuDistances,
    /// The mean of the two means.
    pub overall: f64,
    /// What moved the surface to the scan, where that was asked for.
    pub alignment: Option<Similarity>,
}

/// Measures a surface in the data set's coordinates by the protocol of this module. A mesh without faces is a cloud of
/// points.
///
/// # Errors
/// When the surface has no points within the observation mask or nearer than [`FARTHEST`] to the scan, or so many that its
/// unit cannot be millimetres; when nothing of the scan is above the table or near the surface; when a point is not
/// finite.
pub fn score_dtu(surface: &Mesh, reference: &DtuReference, settings: &DtuSettings) -> Result<DtuScore> {
    let problem = |which, problem| ComparisonError::Surface { which, problem };
    if !surface.vertices.iter().all(|vertex| vertex.is_finite()) {
        return Err(problem("predicted", "has points that are not finite").into());
    }
    let mut points = surface_points(surface)?;
    points.shuffle(&mut ChaCha8Rng::seed_from_u64(settings.seed));
    let mut points = thinned(&points, DENSITY);
    let scan: Vec<DVec3> = reference.scan.vertices.iter().map(|point| point.as_dvec3()).collect();
    let observed = &reference.observed;
    let mut alignment = None;
    if settings.align {
        let found = align(&points, reference)?;
        points.iter_mut().for_each(|point| *point = found.transform_point(*point));
        alignment = Some(found);
    }
    let (low, high) = (observed.low - MARGIN, observed.high + 2.0 * MARGIN);
    points.retain(|point| point.cmpge(low).all() && point.cmplt(high).all());
    let judged: Vec<DVec3> = points.iter().copied().filter(|&point| observed.sees(point)).collect();
    let above: Vec<DVec3> = scan.iter().copied().filter(|&point| reference.is_above_table(point)).collect();
    if judged.is_empty() {
        let words = "has no points within the observation mask: it must be in the data set's coordinates (millimetres)";
        return Err(problem("predicted", words).into());
    }
    if above.is_empty() {
        return Err(problem("true", "has no points above the plane of the table").into());
    }
    let accuracy = distances(&judged, &scan).ok_or(problem("predicted", "is nowhere within 20 mm of the scan"))?;
    let completeness = distances(&above, &points).ok_or(problem("true", "is nowhere within 20 mm of the surface"))?;
    let overall = (accuracy.mean + completeness.mean) / 2.0;
    Ok(DtuScore { accuracy, completeness, overall, alignment })
}

/// From each point to the nearest of others; `None` where none is near enough to count.
fn distances(points: &[DVec3], others: &[DVec3]) -> Option<DtuDistances> {
    let others: Vec<[f64; 3]> = others.iter().map(DVec3::to_array).collect();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&others).ok()?;
    let distance =
        |point: &DVec3| tree.query(&point.to_array()).nearest_one::<SquaredEuclidean<f64>>().execute().distance.sqrt();
    let all: Vec<f64> = points.par_iter().map(distance).collect();
    let mut near: Vec<f64> = all.into_iter().filter(|&distance| distance < FARTHEST).collect();
    let mean = near.iter().sum::<f64>() / near.len().max(1) as f64;
    near.par_sort_unstable_by(f64::total_cmp);
    let beyond = points.len() - near.len();
    (!near.is_empty()).then(|| DtuDistances { points: points.len(), beyond, mean, median: quantile(&near, 0.5) })
}

/// The similarity that brings points, in random order, nearest to the scan.
fn align(points: &[DVec3], reference: &DtuReference) -> Result<Similarity> {
    let observed = &reference.observed;
    // In the middle of the box and in units of its diagonal: a turn about a far origin would move everything.
    let scale = observed.low.distance(observed.high).max(observed.cell);
    let to_world = Similarity { scale, translation: (observed.low + observed.high) / 2.0, ..Similarity::default() };
    let to_box = to_world.inverse();
    let cloud = |points: Vec<DVec3>| points.into_iter().map(|point| to_box.transform_point(point).as_vec3()).collect();
    let near = points.iter().copied().filter(|&point| observed.sees(point)).take(ALIGNED_POINTS);
    let found = PointCloud { points: cloud(near.collect()), ..PointCloud::default() };
    let points: Vec<Vec3> = cloud(reference.scan.vertices.iter().map(|point| point.as_dvec3()).collect());
    let normals = reference.scan.normals.clone().unwrap_or_else(|| estimated_normals(&points));
    let scan = PointCloud { points, normals: Some(normals), colors: None };
    let moved = align_to_surface(&found, &scan, FARTHEST / scale)?;
    Ok(to_world.after(&moved).after(&to_box))
}
