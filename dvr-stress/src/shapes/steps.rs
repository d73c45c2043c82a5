//! A block with a step: a concave edge that a texture may run across without a break.

use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::{Frame, loft};
use glam::{Vec2, Vec3};

use super::placement::{faceted, tilted};

/// A block with a quarter cut away: two faces meet in a concave edge.
pub(crate) fn step() -> Mesh {
    let outline = [(-0.3, -0.3), (0.3, -0.3), (0.3, 0.02), (0.02, 0.02), (0.02, 0.3), (-0.3, 0.3)].map(Vec2::from);
    let frames = [-0.3, 0.3].map(|z| Frame { center: Vec3::Z * z, x: Vec3::X, y: Vec3::Y });
    // The origin sees the whole outline: lids are fans.
    tilted(faceted(loft(&frames, &outline, false)))
}

/// The direction of view straight into the step. A texture that is projected along it does not show the edge.
pub(crate) fn into_step() -> Vec3 {
    let turned = tilted(Mesh { vertices: vec![Vec3::new(-1.0, -1.0, 0.0)], ..Mesh::default() });
    turned.vertices[0].normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::measures::volume;

    #[test]
    fn the_step_is_a_block_less_a_corner() {
        assert!((volume(&step()) - 0.6 * (0.36 - 0.28 * 0.28)).abs() < 1e-4);
        assert!((into_step().length() - 1.0).abs() < 1e-6);
    }
}
