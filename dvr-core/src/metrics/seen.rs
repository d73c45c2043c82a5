//! A surface where views see it: what no photograph shows should not count.

use std::num::NonZero;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::shape::{ShapeScore, score_parts};
use crate::bvh::Bvh;
use crate::camera::Camera;
use crate::error::Result;
use crate::mesh::Mesh;
use crate::points::PointCloud;
use crate::ray::Ray;
use crate::visibility::MIN_COSINE;

/// Views that must see a point: fewer tell nothing of its depth.
pub const LEAST_VIEWS: usize = 2;

/// Points of each surface that are asked for who sees them.
const SAMPLES: usize = 20_000;

/// Points are lifted off a mesh by so much, in edges of the object cube, before it is asked what stands in front of
/// them.
const LIFT: f64 = 2e-3;

/// The radius of the disc that stands for a point of a cloud, in mean distances to the nearest other point. On a
/// surface with points at random, 28 are expected within it: a ray through a gap is not.
const DISC_RADIUS: f64 = 3.0;

/// The score where at least two views see a surface, each surface by itself: points of the true one that two views see
/// past it, to the nearest predicted ones, and points of the predicted one that two views see past that, to the
/// nearest true ones. Lengths are in edges of the object cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenScore {
    /// How many views must see a point.
    pub views: usize,
    /// Share of the true surface that they see.
    pub true_share: f64,
    /// Share of the predicted surface that they see.
    pub predicted_share: f64,
    /// The figures.
    pub score: ShapeScore,
}

/// Scores a mesh, given with points sampled from it at random, against points of the true surface where the cameras see
/// them.
///
/// The true surface is a cloud: each of its points stands for a disc, and discs hide what lies behind them. `None`
/// where there are too few cameras, or the cloud has no normals.
///
/// # Errors
/// As [`score_surface`](super::shape::score_surface).
pub fn score_seen(
    mesh: &Mesh,
    predicted: &PointCloud,
    truth: &PointCloud,
    cameras: &[&Camera],
    thresholds: &[f64],
) -> Result<Option<SeenScore>> {
    let Some((discs, spacing)) = discs(truth).filter(|_| cameras.len() >= LEAST_VIEWS) else { return Ok(None) };
    let part = |cloud: &PointCloud, occluder: &Mesh, lift: f64| {
        let (bvh, stride) = (Bvh::new(occluder), cloud.points.len().div_ceil(SAMPLES).max(1));
        let normals = cloud.normals.as_deref().unwrap_or_default();
        let asked: Vec<(Vec3, Vec3)> =
            cloud.points.iter().zip(normals).step_by(stride).map(|(&point, &normal)| (point, normal)).collect();
        let is_seen = |&(point, normal): &(Vec3, Vec3)| is_seen(&bvh, point, normal, lift, cameras);
        let seen: Vec<(Vec3, Vec3)> = asked.par_iter().copied().filter(is_seen).collect();
        let share = seen.len() as f64 / asked.len().max(1) as f64;
        let (points, normals) = seen.into_iter().unzip();
        (PointCloud { points, normals: Some(normals), colors: None }, share)
    };
    let (seen_truth, true_share) = part(truth, &discs, spacing);
    let (seen_predicted, predicted_share) = part(predicted, mesh, LIFT);
    let score = score_parts([predicted, &seen_predicted], [truth, &seen_truth], thresholds)?;
    Ok(Some(SeenScore { views: LEAST_VIEWS, true_share, predicted_share, score }))
}

/// Whether enough cameras see a point of a surface that turns there into the direction of `normal`.
fn is_seen(bvh: &Bvh, point: Vec3, normal: Vec3, lift: f64, cameras: &[&Camera]) -> bool {
    let (point, normal) = (point.as_dvec3(), normal.as_dvec3());
    let sees = |camera: &&&Camera| {
        let to_camera = camera.center() - point;
        let (pixel, z_depth) = camera.project(point);
        let line = Ray { origin: point + lift * normal, direction: to_camera - lift * normal };
        z_depth > 0.0
            && camera.sees(pixel)
            && normal.dot(to_camera) >= MIN_COSINE * to_camera.length()
            && !bvh.any_hit(&line, 0.0, 1.0)
    };
    cameras.iter().filter(sees).take(LEAST_VIEWS).count() == LEAST_VIEWS
}

/// A square across the normal of each point, as large as the gaps between points ask for, and the points' mean
/// distance to the next.
pub(super) fn discs(cloud: &PointCloud) -> Option<(Mesh, f64)> {
    let normals = cloud.normals.as_ref()?;
    let spacing = spacing(&cloud.points)?;
    // The square has the area of the disc.
    let half_edge = 0.5 * std::f64::consts::PI.sqrt() * DISC_RADIUS * spacing;
    let mut mesh = Mesh::default();
    for (point, normal) in cloud.points.iter().zip(normals) {
        let Some(normal) = normal.as_dvec3().try_normalize() else { continue };
        let (u, v) = normal.any_orthonormal_pair();
        let first = mesh.vertices.len() as u32;
        let corner = |s: f64, t: f64| (point.as_dvec3() + half_edge * (s * u + t * v)).as_vec3();
        mesh.vertices.extend([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
        mesh.faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    Some((mesh, spacing))
}

/// The mean distance from a point to the nearest other one, over a thousand points.
fn spacing(points: &[Vec3]) -> Option<f64> {
    let positions: Vec<[f64; 3]> = points.iter().map(|point| point.as_dvec3().to_array()).collect();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&positions).ok()?;
    let asked = positions.iter().step_by(positions.len().div_ceil(1000).max(1));
    let next = |point: &[f64; 3]| {
        let two = tree.query(point).nearest_n::<SquaredEuclidean<f64>>(NonZero::new(2)?).execute();
        two.iter().map(|near| near.distance).max_by(f64::total_cmp)
    };
    let distances: Vec<f64> = asked.filter_map(next).map(f64::sqrt).collect();
    let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
    (mean > 0.0 && mean.is_finite()).then_some(mean)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::mesh::shapes;
    use crate::metrics::shape::{F_SCORE_THRESHOLDS, score_surface};
    use crate::sampling::sample_surface;

    /// Cameras on a circle about the z axis, all above.
    fn cameras(count: usize) -> Vec<Camera> {
        let at = |i: usize| {
            let (y, x) = (std::f64::consts::TAU * i as f64 / count as f64).sin_cos();
            Camera::look_at(128, 128, 160.0, DVec3::new(1.2 * x, 1.2 * y, 1.0), DVec3::ZERO, DVec3::Z)
        };
        (0..count).map(at).collect()
    }

    fn cloud(mesh: &Mesh, count: usize, seed: u64) -> PointCloud {
        PointCloud::from(sample_surface(mesh, count, seed))
    }

    fn seen(mesh: &Mesh, truth: &Mesh, views: usize) -> SeenScore {
        let cameras = cameras(views);
        let cameras: Vec<&Camera> = cameras.iter().collect();
        let (predicted, truth) = (cloud(mesh, 40_000, 1), cloud(truth, 40_000, 2));
        score_seen(mesh, &predicted, &truth, &cameras, &F_SCORE_THRESHOLDS).unwrap().unwrap()
    }

    #[test]
    fn what_nobody_sees_does_not_count() {
        // A box without its underside, seen from above: nobody sees what is missing.
        let low = Vec3::new(-0.3, -0.3, -0.3);
        let whole = shapes::cuboid(low, Vec3::splat(0.3));
        let mut lid = whole.clone();
        lid.faces.retain(|face| face.iter().any(|&vertex| lid.vertices[vertex as usize].z > 0.0));
        let score = seen(&lid, &whole, 8);
        assert!((score.true_share - 5.0 / 6.0).abs() < 0.03, "{}", score.true_share);
        assert!(score.predicted_share > 0.97, "{}", score.predicted_share);
        let all = score_surface(&cloud(&lid, 40_000, 1), &cloud(&whole, 40_000, 2), &F_SCORE_THRESHOLDS).unwrap();
        assert!(all.completeness > 0.015, "{}", all.completeness);
        // 40 000 points on such a box are .0037 apart.
        assert!(score.score.completeness < 0.004, "{}", score.score.completeness);
        assert!(score.score.f_scores[1].f_score > 0.99 && all.f_scores[1].f_score < 0.95);
    }

    #[test]
    fn a_hollow_is_hidden_by_its_walls_in_clouds_and_meshes_alike() {
        let ball = shapes::icosphere(4, 0.2);
        let both = shapes::union([shapes::icosphere(4, 0.4), ball.clone()]);
        let score = seen(&both, &both, 8);
        // The outer ball has four fifths of the area, and is seen from above; the inner one is not seen at all.
        assert!((score.true_share - score.predicted_share).abs() < 0.03, "{score:?}");
        assert!((0.4..0.75).contains(&score.true_share), "{}", score.true_share);
        let alone = seen(&ball, &both, 8);
        assert!(alone.score.accuracy < 0.005 && alone.score.completeness > 0.15, "{:?}", alone.score);
    }

    #[test]
    fn lids_over_hollows_count_as_wrong() {
        // An open cup, and the same with a lid: two views see the lid, which is nowhere on the cup.
        let mut cup = shapes::cuboid(Vec3::new(-0.3, -0.3, -0.3), Vec3::splat(0.3));
        let filled = cup.clone();
        cup.faces.retain(|face| face.iter().any(|&vertex| cup.vertices[vertex as usize].z < 0.0));
        let inside = Mesh { faces: cup.faces.iter().map(|&[a, b, c]| [a, c, b]).collect(), ..cup.clone() };
        let cup = shapes::union([cup, inside]);
        let score = seen(&filled, &cup, 8);
        assert!(score.score.accuracy > 0.02, "{}", score.score.accuracy);
    }

    #[test]
    fn without_two_views_or_normals_there_is_no_score() {
        let ball = shapes::icosphere(3, 0.4);
        let (cameras, points) = (cameras(3), cloud(&ball, 1000, 1));
        let cameras: Vec<&Camera> = cameras.iter().collect();
        let bare = PointCloud { normals: None, ..points.clone() };
        assert_eq!(score_seen(&ball, &points, &points, &cameras[..1], &[]).unwrap(), None);
        assert_eq!(score_seen(&ball, &points, &bare, &cameras, &[]).unwrap(), None);
        assert!(score_seen(&ball, &points, &points, &cameras, &[]).unwrap().is_some());
    }
}
