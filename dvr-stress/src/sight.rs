//! Visibility: which points of a surface at least two views see, and can therefore be known.

use dvr_core::mesh::Mesh;
use dvr_core::{Bvh, Camera, Ray};
use glam::Vec3;
use rayon::prelude::*;

/// Number of views that must see a point for its position to be known.
const VIEWS: usize = 2;

/// Cosine between normal and line of sight below which a view does not see a point: 80 degrees.
const MIN_COSINE: f64 = 0.174;

/// How far before the point a line of sight may end, as a share of the distance: rounding of the surface itself.
const CLEARANCE: f64 = 1e-3;

/// Whether at least two of the cameras see each point of a mesh: in the frame, from its outer side, with nothing of the
/// mesh in between.
pub(crate) fn seen(mesh: &Mesh, points: &[Vec3], normals: &[Vec3], cameras: &[Camera]) -> Vec<bool> {
    let bvh = Bvh::new(mesh);
    let sees = |camera: &Camera, point: Vec3, normal: Vec3| {
        let (point, normal) = (point.as_dvec3(), normal.as_dvec3());
        let (pixel, depth) = camera.project(point);
        let to_camera = camera.center() - point;
        depth > 0.0
            && camera.sees(pixel)
            && normal.dot(to_camera) > MIN_COSINE * to_camera.length()
            && !bvh.any_hit(&Ray { origin: camera.center(), direction: -to_camera }, 0.0, 1.0 - CLEARANCE)
    };
    (points.par_iter().zip(normals))
        .map(|(&point, &normal)| {
            cameras.iter().filter(|camera| sees(camera, point, normal)).take(VIEWS).count() == VIEWS
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes::{icosphere, union};
    use glam::DVec3;

    use super::*;

    #[test]
    fn two_views_from_one_side_see_that_side_unless_something_is_in_between() {
        let camera = |x: f64| Camera::look_at(64, 64, 56.0, DVec3::new(x, 0.0, 2.0), DVec3::ZERO, DVec3::Y);
        let cameras = [camera(-0.1), camera(0.1)];
        let ball = icosphere(3, 0.3);
        let (front, back) = (Vec3::Z * 0.3, -Vec3::Z * 0.3);
        let both = |mesh: &Mesh| seen(mesh, &[front, back], &[Vec3::Z, -Vec3::Z], &cameras);
        assert_eq!(both(&ball), [true, false]);
        assert_eq!(seen(&ball, &[front], &[Vec3::Z], &cameras[..1]), [false], "one view is not enough");
        let mut screen = icosphere(2, 0.2);
        screen.vertices.iter_mut().for_each(|v| *v += Vec3::Z);
        assert_eq!(both(&union([ball, screen])), [false, false]);
    }
}
