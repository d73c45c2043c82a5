//! Points that a mesh hides from views that must see them: lumps and bridges in front of the true surface.

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::distance::DistanceSummary;
use crate::bvh::Bvh;
use crate::camera::Camera;
use crate::mesh::Mesh;
use crate::ray::Ray;
use crate::sampling::sample_surface;
use crate::verified_points::VerifiedPoints;

/// Samples by which the area of lumps is measured.
const AREA_SAMPLES: usize = 20_000;

/// Which views must see a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Witnesses {
    /// Those that triangulated it.
    Tracks,
    /// The file has no tracks: those that have the point in their frame, of which at least one must see it.
    Frames,
}

/// How much a mesh hides. A line of sight runs from a camera to a point; it is blocked where the mesh stands in front
/// of the point by more than a margin, measured along the line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HiddenPoints {
    /// The margin, in the units of the files.
    pub margin: f64,
    /// Which views must see a point.
    pub witnesses: Witnesses,
    /// Points that have such views.
    pub points: usize,
    /// Lines of sight between these.
    pub sights: usize,
    /// Share of the points that are hidden from all of their views.
    pub hidden_from_all: f64,
    /// Share of the points that are hidden from at least half of the views that triangulated them; `None` without
    /// tracks.
    pub hidden_from_half: Option<f64>,
    /// Share of the lines of sight that are blocked, of those that triangulated points. Where only their number is
    /// known, it is the least that must be blocked: more views triangulated a point than see it. `None` where that is
    /// not known.
    pub blocked_sights: Option<f64>,
    /// How far the mesh stands in front of points: of the blocked lines of sight that triangulated them; without
    /// tracks, of the points that are hidden from all views, each where it is least.
    pub gap: DistanceSummary,
    /// Area of the mesh within the margin of the places where it stands in front, in square units. Points are sparse:
    /// lumps are larger than that.
    pub lump_area: f64,
    /// Share of the mesh's area that this is.
    pub lump_share: f64,
}

/// A place of the mesh that blocks a line of sight.
struct Block {
    /// How far in front of the point it stands.
    gap: f64,
    place: DVec3,
}

/// The lines of sight of one point.
struct PointSights {
    sights: usize,
    blocks: Vec<Block>,
    /// Views that triangulated the point, where that is known.
    triangulated: Option<usize>,
}

/// Asks which points the mesh hides by more than a margin: from the views of their tracks; where there are none, from
/// `cameras`, of the same space. `None` where no point has a view.
pub(super) fn hidden_points(
    mesh: &Mesh,
    bvh: &Bvh,
    verified: &VerifiedPoints,
    cameras: &[&Camera],
    margin: f64,
) -> Option<HiddenPoints> {
    let witnesses = if verified.tracks.is_some() { Witnesses::Tracks } else { Witnesses::Frames };
    let of_point = |(index, &point): (usize, &DVec3)| {
        let block = |camera: &Camera| block(bvh, camera, point, margin);
        let (sights, blocks) = match &verified.tracks {
            Some(tracks) => {
                let sights = &tracks.sights[index];
                (sights.len(), sights.iter().filter_map(|sight| block(&tracks.cameras[sight.camera])).collect())
            }
            None => {
                let in_frame = || cameras.iter().filter(|camera| shows(camera, point));
                (in_frame().count(), in_frame().filter_map(|camera| block(camera)).collect())
            }
        };
        let triangulated = verified.track_lengths.as_ref().map(|lengths| lengths[index].min(sights));
        PointSights { sights, blocks, triangulated }
    };
    let points: Vec<PointSights> = verified.points.par_iter().enumerate().map(of_point).collect();
    let points: Vec<PointSights> = points.into_iter().filter(|point| point.sights > 0).collect();
    if points.is_empty() {
        return None;
    }
    Some(summary(mesh, &points, witnesses, margin))
}

fn summary(mesh: &Mesh, points: &[PointSights], witnesses: Witnesses, margin: f64) -> HiddenPoints {
    let share = |holds: &dyn Fn(&PointSights) -> bool| {
        points.iter().filter(|point| holds(point)).count() as f64 / points.len() as f64
    };
    let is_hidden = |point: &PointSights| point.blocks.len() == point.sights;
    let counted: Vec<&Block> = match witnesses {
        Witnesses::Tracks => points.iter().flat_map(|point| &point.blocks).collect(),
        Witnesses::Frames => {
            let hidden = points.iter().filter(|point| is_hidden(point));
            hidden.filter_map(|point| point.blocks.iter().min_by(|a, b| a.gap.total_cmp(&b.gap))).collect()
        }
    };
    let sights: usize = points.iter().map(|point| point.sights).sum();
    let blocked_sights = match witnesses {
        Witnesses::Tracks => Some(counted.len() as f64 / sights as f64),
        Witnesses::Frames => least_blocked(points),
    };
    let half = |point: &PointSights| 2 * point.blocks.len() >= point.sights;
    let places: Vec<DVec3> = counted.iter().map(|block| block.place).collect();
    let lump_share = share_near(mesh, &places, margin);
    HiddenPoints {
        margin,
        witnesses,
        points: points.len(),
        sights,
        hidden_from_all: share(&is_hidden),
        hidden_from_half: (witnesses == Witnesses::Tracks).then(|| share(&half)),
        blocked_sights,
        gap: DistanceSummary::new(counted.iter().map(|block| block.gap).collect(), &[]),
        lump_area: lump_share * area(mesh),
        lump_share,
    }
}

/// The share of the lines of sight that triangulated points which must be blocked, because fewer views see the points.
fn least_blocked(points: &[PointSights]) -> Option<f64> {
    let (mut blocked, mut all) = (0, 0);
    for point in points {
        let triangulated = point.triangulated?;
        blocked += triangulated.saturating_sub(point.sights - point.blocks.len());
        all += triangulated;
    }
    (all > 0).then(|| blocked as f64 / all as f64)
}

/// Whether a point is in front of a camera and in its frame.
fn shows(camera: &Camera, point: DVec3) -> bool {
    let (pixel, z_depth) = camera.project(point);
    z_depth > 0.0 && camera.sees(pixel)
}

/// Where the mesh first stands between camera and point, if it does so by more than the margin.
fn block(bvh: &Bvh, camera: &Camera, point: DVec3, margin: f64) -> Option<Block> {
    let origin = camera.center();
    let ray = Ray { origin, direction: point - origin };
    let distance = ray.direction.length();
    let hit = bvh.closest_hit(&ray, 0.0, 1.0 - margin / distance)?;
    Some(Block { gap: (1.0 - hit.ray_depth) * distance, place: ray.at(hit.ray_depth) })
}

/// The share of the mesh's area that is nearer to one of the places than `radius`.
fn share_near(mesh: &Mesh, places: &[DVec3], radius: f64) -> f64 {
    let positions: Vec<[f64; 3]> = places.iter().map(|place| place.to_array()).collect();
    let Some(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions).ok().filter(|_| !places.is_empty()) else {
        return 0.0;
    };
    let samples = sample_surface(mesh, AREA_SAMPLES, 0).points;
    let is_near = |point: &&glam::Vec3| {
        let query = point.as_dvec3().to_array();
        tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute().distance < radius * radius
    };
    samples.par_iter().filter(is_near).count() as f64 / samples.len().max(1) as f64
}

/// The area of all faces.
fn area(mesh: &Mesh) -> f64 {
    let of_face = |face| {
        let [a, b, c] = mesh.triangle(face).map(|corner| corner.as_dvec3());
        0.5 * (b - a).cross(c - a).length()
    };
    (0..mesh.faces.len()).map(of_face).sum()
}
