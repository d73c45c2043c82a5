//! What a mesh scores against verified points.

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::distance::DistanceSummary;
use super::extent::{extent, round_numbers};
use super::floor::{PointsFloor, points_floor};
use super::hidden::{HiddenPoints, hidden_points};
use crate::bvh::Bvh;
use crate::camera::Camera;
use crate::error::{ComparisonError, Result};
use crate::mesh::Mesh;
use crate::verified_points::VerifiedPoints;

/// Share of the extent of the points where the thresholds begin that nobody asked for.
const FIRST_THRESHOLD: f64 = 1e-3;

/// How many thresholds there are then.
const THRESHOLDS: usize = 5;

/// Share of the extent of the points that the mesh may stand in front of a point, before it is rounded down.
const MARGIN: f64 = 5e-3;

/// Splits tracks: the floor belongs to the points, and is the same for every mesh.
const FLOOR_SEED: u64 = 0;

/// How a mesh is measured by points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointsSettings {
    /// Distances below which points are counted, in the units of the files. Where none are given: five round numbers
    /// (of 1, 2, 5, 10, ...) from a thousandth of the points' extent on.
    pub thresholds: Vec<f64>,
    /// How far the mesh may stand in front of a point, along the line of sight and in the units of the files, before it
    /// hides it. `None`: the largest number of 1, 2, 5, 10, ... that does not exceed 0.5 % of the points' extent.
    pub margin: Option<f64>,
}

impl PointsSettings {
    /// Thresholds and margin, by the extent of these points where nobody asked for others; `None` for a margin where
    /// they have no extent.
    pub(in crate::metrics) fn for_points(&self, points: &[DVec3]) -> (Vec<f64>, Option<f64>) {
        let extent = extent(points);
        let by_extent = || round_numbers(FIRST_THRESHOLD * extent, THRESHOLDS);
        let thresholds = if self.thresholds.is_empty() { by_extent() } else { self.thresholds.clone() };
        (thresholds, self.margin.or_else(|| round_numbers(MARGIN * extent, 1).first().copied()))
    }
}

/// A mesh against verified points. Lengths are in the units of the files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointsScore {
    /// How many points there are.
    pub points: usize,
    /// How large their cloud is: the diagonal of the box that holds all but the outermost 1 % on each side.
    pub extent: f64,
    /// From each point to the nearest place of the mesh.
    pub distances: DistanceSummary,
    /// What the mesh hides; `None` where no view is known that must see a point.
    pub hidden: Option<HiddenPoints>,
    /// What the true surface would score; `None` where the pictures of the points are not known, or all tracks are
    /// short.
    pub floor: Option<PointsFloor>,
}

/// Measures a mesh by points of the same space: the exact distance from each to the nearest place of a triangle, edges
/// and corners included. Where the points have no tracks, `cameras` of the same space tell which of them the mesh
/// hides; there may be none.
///
/// # Errors
/// When the mesh has no faces, there are no points, or a point is not finite.
pub fn score_points(
    mesh: &Mesh,
    verified: &VerifiedPoints,
    cameras: &[&Camera],
    settings: &PointsSettings,
) -> Result<PointsScore> {
    let surface = |which, problem| ComparisonError::Surface { which, problem };
    if verified.points.is_empty() {
        return Err(surface("true", "has no points").into());
    }
    if mesh.faces.is_empty() {
        return Err(surface("predicted", "has no faces").into());
    }
    let bvh = Bvh::new(mesh);
    let distance = |point: &DVec3| bvh.nearest(*point).map(|nearest| nearest.distance);
    let distances: Option<Vec<f64>> = verified.points.par_iter().map(distance).collect();
    let distances = distances.ok_or_else(|| surface("true", "has points that are not finite"))?;
    let (thresholds, margin) = settings.for_points(&verified.points);
    Ok(PointsScore {
        points: verified.points.len(),
        extent: extent(&verified.points),
        distances: DistanceSummary::new(distances, &thresholds),
        hidden: margin.and_then(|margin| hidden_points(mesh, &bvh, verified, cameras, margin)),
        floor: verified.tracks.as_ref().and_then(|tracks| points_floor(tracks, FLOOR_SEED)),
    })
}
