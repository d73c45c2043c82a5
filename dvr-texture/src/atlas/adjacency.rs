//! Which faces of a mesh lie across each other's edges.

use dvr_core::mesh::Mesh;

/// Nothing lies across an edge.
pub(super) const NONE: u32 = u32::MAX;

/// For each face the neighbours across its edges `(0, 1)`, `(1, 2)` and `(2, 0)`; [`NONE`] at a border, and where more than
/// two faces meet or they do not wind alike.
pub(super) fn neighbours(mesh: &Mesh) -> Vec<[u32; 3]> {
    // Lower and higher vertex, then whether the edge runs from low to high, face and edge of the face.
    let mut edges: Vec<(u32, u32, bool, u32, usize)> = Vec::with_capacity(3 * mesh.faces.len());
    for (face, corners) in mesh.faces.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            edges.push((a.min(b), a.max(b), a < b, face as u32, k));
        }
    }
    edges.sort_unstable();
    let mut neighbours = vec![[NONE; 3]; mesh.faces.len()];
    for edge in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
        if let [(_, _, backward, first, i), (_, _, forward, second, k)] = *edge
            && backward != forward
        {
            neighbours[first as usize][i] = second;
            neighbours[second as usize][k] = first;
        }
    }
    neighbours
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;

    use super::*;

    #[test]
    fn a_closed_mesh_has_a_neighbour_across_each_edge_and_they_know_each_other() {
        let ball = shapes::icosphere(2, 0.4);
        let neighbours = neighbours(&ball);
        for (face, across) in neighbours.iter().enumerate() {
            assert!(across.iter().all(|&other| neighbours[other as usize].contains(&(face as u32))));
        }
        let mut torn = ball.clone();
        torn.faces.truncate(1);
        assert_eq!(super::neighbours(&torn), [[NONE; 3]]);
        torn.faces = vec![ball.faces[0]; 3];
        assert!(super::neighbours(&torn).concat().iter().all(|&other| other == NONE), "three at an edge");
    }
}
