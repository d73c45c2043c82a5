//! Which views see a point of a surface, and how much a surface deserves to be believed for that.

use std::borrow::Cow;

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::camera::Camera;
use crate::mesh::{Mesh, shapes};
use crate::observation::Observation;
use crate::ray::Ray;

/// Cosine between the line of sight and the normal below which a view does not see a surface: beyond 78 degrees a pixel
/// covers five times its width of it.
pub const MIN_COSINE: f64 = 0.2;

/// Share of the distance to the camera that a line of sight leaves the surface by before it is tested for occlusion.
const CLEARANCE: f64 = 2e-3;

/// How one view sees a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Which view.
    pub view: usize,
    /// Where on its picture, in pixel coordinates.
    pub pixel: DVec2,
    /// z-depth, in the units of the mesh.
    pub z_depth: f64,
    /// Cosine between the line of sight and the normal.
    pub cosine: f64,
}

/// A mesh, ready to be asked which cameras see its vertices.
#[derive(Debug)]
pub struct Visibility<'a> {
    mesh: &'a Mesh,
    normals: Cow<'a, [Vec3]>,
    bvh: Bvh,
}

impl<'a> Visibility<'a> {
    /// Builds the hierarchy that finds what is in between. Normals that the mesh does not have are taken from its
    /// faces.
    pub fn new(mesh: &'a Mesh) -> Self {
        let normals = match &mesh.normals {
            Some(normals) => Cow::Borrowed(normals.as_slice()),
            None => Cow::Owned(shapes::vertex_normals(&mesh.vertices, &mesh.faces)),
        };
        Self { mesh, normals, bvh: Bvh::new(mesh) }
    }

    /// How a camera of the mesh's space, the `view`-th, sees a vertex; `None` where it does not.
    pub fn sight(&self, vertex: usize, view: usize, camera: &Camera) -> Option<Sight> {
        let point = self.mesh.vertices[vertex].as_dvec3();
        let (pixel, z_depth) = camera.project(point);
        if z_depth <= 0.0 || !camera.sees(pixel) {
            return None;
        }
        let to_camera = camera.center() - point;
        let cosine = self.normals[vertex].as_dvec3().dot(to_camera) / to_camera.length();
        let line = Ray { origin: point, direction: to_camera };
        (cosine >= MIN_COSINE && !self.bvh.any_hit(&line, CLEARANCE, 1.0)).then_some(Sight {
            view,
            pixel,
            z_depth,
            cosine,
        })
    }

    /// How the cameras together see each vertex.
    pub fn observe(&self, cameras: &[&Camera]) -> Vec<Observation> {
        let of_vertex = |vertex| {
            let sights = cameras.iter().enumerate().filter_map(|(i, camera)| self.sight(vertex, i, camera));
            Observation::of(sights.map(|sight| sight.cosine))
        };
        (0..self.mesh.vertices.len()).into_par_iter().map(of_vertex).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn camera(eye: DVec3) -> Camera {
        Camera::look_at(64, 64, 64.0, eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.2))
    }

    fn nearest(mesh: &Mesh, direction: Vec3) -> usize {
        let along = |i: usize| mesh.vertices[i].dot(direction);
        (0..mesh.vertices.len()).max_by(|&a, &b| along(a).total_cmp(&along(b))).unwrap()
    }

    #[test]
    fn a_ball_seen_from_one_side_is_half_known_in_front_and_unknown_behind() {
        let ball = shapes::icosphere(4, 0.4);
        let front = camera(2.0 * DVec3::Z);
        let seen = Visibility::new(&ball).observe(&[&front]);
        let (near, far) = (seen[nearest(&ball, Vec3::Z)], seen[nearest(&ball, Vec3::NEG_Z)]);
        assert!(near.views == 1 && (near.confidence - 0.5).abs() < 0.01, "{near:?}");
        assert_eq!(far, Observation::default());
        // From a distance d the cap with cosine c to the eye is seen: here it is a bit less than two fifths of the
        // ball.
        let share = seen.iter().filter(|o| o.views > 0).count() as f64 / seen.len() as f64;
        assert!((0.28..0.42).contains(&share), "{share}");
    }

    #[test]
    fn more_views_and_steeper_ones_are_worth_more() {
        assert_eq!(Observation::of([]), Observation { views: 0, confidence: 0.0 });
        assert_eq!(Observation::of([1.0]), Observation { views: 1, confidence: 0.5 });
        assert_eq!(Observation::of([0.5, 1.0]), Observation { views: 2, confidence: 0.75 });
        assert_eq!(Observation::of([0.5, 0.5]), Observation { views: 2, confidence: 0.375 });
        let many = Observation::of(vec![1.0; 70_000]);
        assert!(many.views == u16::MAX && many.confidence == 1.0);
    }

    #[test]
    fn what_stands_in_between_or_outside_the_frame_is_not_seen() {
        let ball = shapes::icosphere(3, 0.4);
        let front = nearest(&ball, Vec3::Z);
        let screen = shapes::cuboid(Vec3::new(-0.6, -0.6, 0.8), Vec3::new(0.6, 0.6, 0.82));
        let both = shapes::union([ball.clone(), screen]);
        let eye = camera(2.0 * DVec3::Z);
        assert!(Visibility::new(&ball).sight(front, 0, &eye).is_some());
        assert!(Visibility::new(&both).sight(front, 0, &eye).is_none(), "behind the screen");
        let beside = Camera::look_at(64, 64, 64.0, 2.0 * DVec3::Z, DVec3::new(3.0, 0.0, 0.0), DVec3::Y);
        assert!(Visibility::new(&ball).sight(front, 0, &beside).is_none(), "outside the frame");
    }
}
