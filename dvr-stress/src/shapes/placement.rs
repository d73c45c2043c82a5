//! How shapes are turned and shaded.

use dvr_core::mesh::Mesh;
use glam::{Quat, Vec3};

/// Rotates a mesh, so that no face is parallel to a grid.
pub(super) fn tilted(mesh: Mesh) -> Mesh {
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.5, 0.3, 0.2);
    let turned = |v: &Vec3| turn * *v;
    Mesh {
        vertices: mesh.vertices.iter().map(turned).collect(),
        normals: mesh.normals.map(|normals| normals.iter().map(turned).collect()),
        ..mesh
    }
}

/// Removes vertex normals: faces are flat and edges hard.
pub(super) fn faceted(mesh: Mesh) -> Mesh {
    Mesh { normals: None, ..mesh }
}
