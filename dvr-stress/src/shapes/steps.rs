//! A block with a step: an edge that a texture may run across as if it were not there.

use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::{Frame, loft};
use glam::{Vec2, Vec3};

use super::tilted;

/// A block with a quarter cut away: two faces meet in a concave edge.
pub(crate) fn step() -> Mesh {
    let outline = [(-0.3, -0.3), (0.3, -0.3), (0.3, 0.02), (0.02, 0.02), (0.02, 0.3), (-0.3, 0.3)].map(Vec2::from);
    let frames = [-0.3, 0.3].map(|z| Frame { center: Vec3::Z * z, x: Vec3::X, y: Vec3::Y });
    // The origin sees the whole outline: lids are fans.
    tilted(super::faceted(loft(&frames, &outline, false)))
}

/// The direction that looks straight into the step: from there a texture that is projected along it shows no edge.
pub(crate) fn into_step() -> Vec3 {
    let turned = tilted(Mesh { vertices: vec![Vec3::new(-1.0, -1.0, 0.0)], ..Mesh::default() });
    turned.vertices[0].normalize()
}

#[cfg(test)]
mod tests {
    use super::super::measures::volume;
    use super::*;

    #[test]
    fn the_step_is_a_block_less_a_corner() {
        assert!((volume(&step()) - 0.6 * (0.36 - 0.28 * 0.28)).abs() < 1e-4);
        assert!((into_step().length() - 1.0).abs() < 1e-6);
    }
}
