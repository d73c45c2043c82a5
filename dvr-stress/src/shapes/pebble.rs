//! The object that faults are tried on.

use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::{icosphere, vertex_normals};
use glam::Vec3;

/// A pebble with dents: round enough to be easy, with hollows that silhouettes alone do not show.
pub(crate) fn pebble() -> Mesh {
    let ball = icosphere(5, 1.0);
    let radius = |n: Vec3| {
        let waves = (4.0 * n.x + 1.0).sin() * (3.5 * n.y).cos() + 0.8 * (4.5 * n.z + 0.5).sin() * (3.0 * n.x).cos();
        0.32 * (1.0 + 0.16 * waves)
    };
    let vertices: Vec<Vec3> = ball.vertices.iter().map(|&n| radius(n) * n).collect();
    let normals = Some(vertex_normals(&vertices, &ball.faces));
    Mesh { vertices, normals, ..ball }
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::Topology;

    use super::*;

    #[test]
    fn a_pebble_is_one_closed_component_in_the_cube() {
        let mesh = pebble();
        assert_eq!(Topology::of(&mesh).handles(), Some(0));
        assert!(mesh.vertices.iter().all(|v| v.abs().max_element() < 0.45));
    }
}
