//! Measures of meshes, for the tests of shapes.

use dvr_core::mesh::Mesh;
use glam::Vec3;

/// Extent of a mesh along a direction.
pub(super) fn extent(mesh: &Mesh, direction: Vec3) -> f32 {
    let heights = || mesh.vertices.iter().map(|v| v.dot(direction.normalize()));
    heights().fold(f32::NEG_INFINITY, f32::max) - heights().fold(f32::INFINITY, f32::min)
}

/// Enclosed volume: positive for a surface that is wound outwards.
pub(super) fn volume(mesh: &Mesh) -> f32 {
    (0..mesh.faces.len()).map(|f| mesh.triangle(f)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}
