//! The plane that an object stands on, among points that photographs show.

use glam::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Planes through three points that are tried.
const TRIES: usize = 4000;

/// Points on a plane are nearer to it than this, object units.
const ON_PLANE: f32 = 0.01;

/// What is closer to the support plane than this is not the object, object units.
pub(crate) const LYING: f32 = 0.004;

/// Points that lie further behind it than this speak against a plane.
const BEHIND: f32 = 0.03;

/// The share of the points that must lie on the plane.
const MIN_ON: f64 = 0.08;

/// The share of the points that may lie behind it: cameras see nothing through a table.
const MAX_BEHIND: f64 = 0.05;

/// The share of the points that must stand out of it: else it is the object itself that is flat.
const MIN_BEFORE: f64 = 0.03;

/// Cameras are further before the plane than this, as a share of their distance to the middle of the scene.
const CAMERAS_BEFORE: f32 = 0.02;

/// The share of the points on the plane that must lie further out than what stands on it: else it is the object's own foot.
const MIN_BESIDE: f64 = 0.5;

/// The share of what stands on the plane that counts for how far out it reaches.
const STANDING: f64 = 0.95;

/// A plane; what the object stands on, with the object before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SupportPlane {
    /// Unit normal, towards the object.
    pub normal: Vec3,
    /// Along the normal, from the origin.
    pub offset: f32,
}

impl SupportPlane {
    /// Distance to the plane, positive on the object's side.
    pub fn distance(&self, point: Vec3) -> f32 {
        self.normal.dot(point) - self.offset
    }

    fn through([a, b, c]: [Vec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(Self { normal, offset: normal.dot(a) })
    }

    fn towards(self, point: Vec3) -> Self {
        if self.distance(point) < 0.0 { Self { normal: -self.normal, offset: -self.offset } } else { self }
    }

    /// The plane of least squares through points.
    fn fitted(points: &[Vec3]) -> Option<Self> {
        let count = points.len() as f64;
        let mean = points.iter().map(|point| point.as_dvec3()).sum::<glam::DVec3>() / count;
        let mut moments = glam::DMat3::ZERO;
        for point in points {
            let d = point.as_dvec3() - mean;
            moments += glam::DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        }
        // The direction of least spread, by the power method on what is left of the largest.
        let trace = moments.x_axis.x + moments.y_axis.y + moments.z_axis.z;
        let turned = glam::DMat3::from_diagonal(glam::DVec3::splat(trace)) - moments;
        let mut normal = turned * glam::DVec3::new(0.3, 0.5, 0.8);
        for _ in 0..200 {
            normal = (turned * normal).try_normalize()?;
        }
        let normal = normal.as_vec3();
        Some(Self { normal, offset: normal.dot(mean.as_vec3()) })
    }
}

/// The plane with the most points that all cameras are before, that next to nothing lies behind, and that something
/// stands on (RANSAC: Fischler and Bolles 1981). `None` where there is none.
pub(crate) fn support_plane(points: &[Vec3], cameras: &[Vec3]) -> Option<SupportPlane> {
    let count = points.len();
    if count < 50 {
        return None;
    }
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut best: Option<(usize, SupportPlane)> = None;
    let share = |part: usize| part as f64 / count as f64;
    let middle = cameras.iter().sum::<Vec3>() / cameras.len() as f32;
    let on = |plane: &SupportPlane| points.iter().filter(|point| plane.distance(**point).abs() < ON_PLANE).count();
    let is_support = |plane: &SupportPlane| {
        let before = |camera: &Vec3| plane.distance(*camera) > CAMERAS_BEFORE * camera.length();
        let behind = points.iter().filter(|point| plane.distance(**point) < -BEHIND).count();
        let standing = points.iter().filter(|point| plane.distance(**point) > BEHIND).count();
        cameras.iter().all(before) && share(behind) <= MAX_BEHIND && share(standing) >= MIN_BEFORE
    };
    let reaches_out = |plane: &SupportPlane| {
        let across = |point: &&Vec3| **point - plane.distance(**point) * plane.normal;
        let standing: Vec<Vec3> =
            points.iter().filter(|point| plane.distance(**point) > BEHIND).map(|point| across(&point)).collect();
        let middle = standing.iter().sum::<Vec3>() / standing.len().max(1) as f32;
        let mut radii: Vec<f32> = standing.iter().map(|point| point.distance(middle)).collect();
        radii.sort_by(f32::total_cmp);
        let radius = radii.get((STANDING * radii.len() as f64) as usize).copied().unwrap_or(f32::INFINITY);
        let lying: Vec<Vec3> = (points.iter().filter(|point| plane.distance(**point).abs() < ON_PLANE))
            .map(|point| across(&point))
            .collect();
        let beside = lying.iter().filter(|point| point.distance(middle) > radius).count();
        beside as f64 >= MIN_BESIDE * lying.len() as f64
    };
    for _ in 0..TRIES {
        let corners = [(); 3].map(|()| points[rng.random_range(0..count)]);
        let Some(plane) = SupportPlane::through(corners).map(|plane| plane.towards(middle)) else { continue };
        let found = on(&plane);
        if best.is_none_or(|(most, _)| found > most)
            && share(found) >= MIN_ON
            && is_support(&plane)
            && reaches_out(&plane)
        {
            best = Some((found, plane));
        }
    }
    let (_, mut plane) = best?;
    for _ in 0..3 {
        let near: Vec<Vec3> = points.iter().copied().filter(|point| plane.distance(*point).abs() < ON_PLANE).collect();
        plane = SupportPlane::fitted(&near)?.towards(middle);
    }
    Some(plane)
}
