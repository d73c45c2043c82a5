//! True shapes, in object space. All are closed, and no two parts of one overlap: samples of the surface are the
//! surface.

mod concave;
mod parts;
mod pebble;
mod perforated;
mod steps;
mod thin;

pub(crate) use concave::{bowl, tunnel};
pub(crate) use parts::{far_apart, tiny_beside_large};
pub(crate) use pebble::pebble;
pub(crate) use perforated::perforated;
pub(crate) use steps::{into_step, step};
pub(crate) use thin::{plate, ring, wedge};

use dvr_core::mesh::Mesh;
use glam::{Quat, Vec3};

/// Turned out of the axes, so that no face lies along a grid.
fn tilted(mesh: Mesh) -> Mesh {
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.5, 0.3, 0.2);
    let turned = |v: &Vec3| turn * *v;
    Mesh {
        vertices: mesh.vertices.iter().map(turned).collect(),
        normals: mesh.normals.map(|normals| normals.iter().map(turned).collect()),
        ..mesh
    }
}

/// Without vertex normals: faces are flat and edges hard.
fn faceted(mesh: Mesh) -> Mesh {
    Mesh { normals: None, ..mesh }
}

#[cfg(test)]
pub(crate) mod measures {
    use dvr_core::mesh::Mesh;
    use glam::Vec3;

    /// How far the mesh reaches along a direction, from end to end.
    pub fn extent(mesh: &Mesh, direction: Vec3) -> f32 {
        let heights = || mesh.vertices.iter().map(|v| v.dot(direction.normalize()));
        heights().fold(f32::NEG_INFINITY, f32::max) - heights().fold(f32::INFINITY, f32::min)
    }

    /// Enclosed volume: positive for a surface that is wound outwards.
    pub fn volume(mesh: &Mesh) -> f32 {
        (0..mesh.faces.len()).map(|f| mesh.triangle(f)).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }
}
