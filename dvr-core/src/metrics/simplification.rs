//! How far simplification moved a surface.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bvh::Bvh;
use crate::mesh::Mesh;

/// What simplification did to a mesh: what it had before, how far its surface moved, and whether it is watertight.
///
/// Distances are between the two surfaces, from vertices of the full one to the nearest place of the simple one, and from
/// the middles of the simple one's faces to the full one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Simplification {
    /// Faces before.
    pub faces_before: usize,
    /// Mean distance: the larger one of the two directions.
    pub mean_distance: f64,
    /// Largest distance of either direction.
    pub max_distance: f64,
    /// Edges of the simple mesh that are not shared by two faces: none where it is watertight.
    pub open_edges: usize,
}

impl Simplification {
    /// Compares a full mesh with the simple one that was made of it; in the meshes' units. Distances from or to a mesh
    /// without faces are 0.
    pub fn between(full: &Mesh, simple: &Mesh) -> Self {
        let mut used = vec![false; full.vertices.len()];
        full.faces.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
        let vertices = full.vertices.iter().zip(used).filter(|(_, used)| *used).map(|(vertex, _)| vertex.as_dvec3());
        let middles = (0..simple.faces.len()).map(|face| {
            let [a, b, c] = simple.triangle(face).map(|corner| corner.as_dvec3());
            (a + b + c) / 3.0
        });
        let (forth, back) = (distances(vertices.collect(), simple), distances(middles.collect(), full));
        Self {
            faces_before: full.faces.len(),
            mean_distance: forth.0.max(back.0),
            max_distance: forth.1.max(back.1),
            open_edges: simple.open_edges(),
        }
    }

    /// The same where a unit of the meshes is so many.
    #[must_use]
    pub fn scaled(self, scale: f64) -> Self {
        Self { mean_distance: scale * self.mean_distance, max_distance: scale * self.max_distance, ..self }
    }
}

/// Mean and largest distance to a surface.
fn distances(points: Vec<glam::DVec3>, surface: &Mesh) -> (f64, f64) {
    let surface = Bvh::new(surface);
    let nearest: Vec<f64> =
        points.par_iter().filter_map(|point| surface.nearest(*point).map(|nearest| nearest.distance)).collect();
    // One after the other: the sum does not depend on the number of threads.
    let (sum, max) = nearest.iter().fold((0.0, 0.0f64), |(sum, max), &distance| (sum + distance, max.max(distance)));
    (sum / nearest.len().max(1) as f64, max)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::mesh::shapes::{cuboid, icosphere, union};

    #[test]
    fn a_ball_of_fewer_faces_is_as_far_off_as_its_flat_faces_are() {
        let (fine, coarse) = (icosphere(5, 0.4), icosphere(3, 0.4));
        let moved = Simplification::between(&fine, &coarse);
        // The middle of the largest face is the deepest place.
        let depth = (0..coarse.faces.len())
            .map(|face| 0.4 - f64::from((coarse.triangle(face).iter().sum::<Vec3>() / 3.0).length()))
            .fold(0.0, f64::max);
        // The fine ball has a depth of its own, a sixteenth of that.
        assert!((moved.max_distance / (15.0 / 16.0 * depth) - 1.0).abs() < 0.02, "{moved:?}, {depth}");
        assert!(moved.mean_distance > 0.2 * depth && moved.mean_distance < moved.max_distance);
        assert_eq!(moved.faces_before, fine.faces.len());
        let scaled = moved.scaled(10.0);
        assert_eq!((scaled.max_distance, scaled.faces_before), (10.0 * moved.max_distance, fine.faces.len()));
    }

    #[test]
    fn a_piece_that_is_gone_counts_and_so_does_one_that_is_new() {
        let cube = cuboid(Vec3::ZERO, Vec3::ONE);
        let both = union([cube.clone(), cuboid(Vec3::new(3.0, 0.0, 0.0), Vec3::new(4.0, 1.0, 1.0))]);
        assert_eq!(Simplification::between(&both, &cube).max_distance, 3.0);
        assert!(Simplification::between(&cube, &both).max_distance > 2.5);
        let same = Simplification::between(&cube, &cube);
        assert_eq!((same.mean_distance, same.max_distance), (0.0, 0.0));
        assert_eq!(Simplification::between(&cube, &Mesh::default()).max_distance, 0.0);
    }
}
