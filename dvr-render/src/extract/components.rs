//! Connected components of a mesh, and how to drop the small ones.

use dvr_core::mesh::{Mesh, connected_components};
use glam::Vec3;

/// How many connected components a mesh has: faces that share vertices.
pub fn count_components(mesh: &Mesh) -> usize {
    connected_components(mesh.vertices.len(), &mesh.faces).1
}

/// Drops every connected piece whose area is below `min_share` of the largest piece's, and vertices that no face uses.
///
/// A closed mesh stays closed: components go whole. Returns how many were dropped.
pub fn drop_small_components(mesh: &mut Mesh, min_share: f64) -> usize {
    let (_, dropped) = retain_large(&mesh.vertices, &mut mesh.faces, min_share);
    let kept = compact(&mut mesh.faces, mesh.vertices.len());
    mesh.vertices = select(&mesh.vertices, &kept);
    mesh.normals = mesh.normals.take().map(|normals| select(&normals, &kept));
    mesh.colors = mesh.colors.take().map(|colors| select(&colors, &kept));
    dropped
}

/// Drops the faces of small components; how many were kept, and how many dropped.
pub(super) fn retain_large(vertices: &[Vec3], faces: &mut Vec<[u32; 3]>, min_share: f64) -> (usize, usize) {
    let (labels, count) = connected_components(vertices.len(), faces);
    let mut areas = vec![0.0; count];
    for (face, &label) in faces.iter().zip(&labels) {
        let [a, b, c] = face.map(|vertex| vertices[vertex as usize].as_dvec3());
        areas[label as usize] += 0.5 * (b - a).cross(c - a).length();
    }
    let smallest = min_share * areas.iter().copied().fold(0.0, f64::max);
    let mut labels = labels.into_iter();
    faces.retain(|_| labels.next().is_some_and(|label| areas[label as usize] >= smallest));
    let kept = areas.iter().filter(|&&area| area >= smallest).count();
    (kept, count - kept)
}

/// Renumbers the faces' vertices so that unused ones are left out; the old numbers of those that stay.
pub(super) fn compact(faces: &mut [[u32; 3]], vertex_count: usize) -> Vec<u32> {
    let mut used = vec![false; vertex_count];
    faces.iter().flatten().for_each(|&vertex| used[vertex as usize] = true);
    let kept: Vec<u32> = (0..vertex_count as u32).filter(|&vertex| used[vertex as usize]).collect();
    let mut renumbered = vec![0; vertex_count];
    kept.iter().enumerate().for_each(|(new, &old)| renumbered[old as usize] = new as u32);
    faces.iter_mut().flatten().for_each(|vertex| *vertex = renumbered[*vertex as usize]);
    kept
}

/// The items at the given places.
pub(super) fn select<T: Copy>(items: &[T], places: &[u32]) -> Vec<T> {
    places.iter().map(|&place| items[place as usize]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A large triangle, a small one, a vertex that nothing uses.
    fn two_components() -> Mesh {
        let vertices =
            vec![Vec3::Z, Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE, Vec3::ONE + 0.1 * Vec3::X, Vec3::splat(1.1)];
        let colors = Some((0..7).map(|k| [k as f32 / 6.0; 3]).collect());
        Mesh { vertices, faces: vec![[4, 5, 6], [1, 2, 3]], colors, ..Mesh::default() }
    }

    #[test]
    fn a_small_piece_goes_with_its_vertices_and_colors() {
        let mut mesh = two_components();
        assert_eq!(drop_small_components(&mut mesh, 0.5), 1);
        assert_eq!(mesh.vertices, [Vec3::ZERO, Vec3::X, Vec3::Y]);
        assert_eq!(mesh.faces, [[0, 1, 2]]);
        assert_eq!(mesh.colors.unwrap()[0], [1.0 / 6.0; 3]);
    }

    #[test]
    fn shares_are_of_the_area_wherever_the_pieces_lie() {
        // Twice the edge is four times the area.
        let corners = |at: Vec3, edge: f32| [at, at + edge * Vec3::X, at + edge * Vec3::Y];
        let vertices = [corners(Vec3::new(5.0, -3.0, 2.0), 2.0), corners(Vec3::new(-4.0, 1.0, 7.0), 1.0)].concat();
        let mesh = Mesh { vertices, faces: vec![[0, 1, 2], [3, 4, 5]], ..Mesh::default() };
        for (min_share, dropped) in [(0.24, 0), (0.25, 0), (0.26, 1)] {
            assert_eq!(drop_small_components(&mut mesh.clone(), min_share), dropped, "{min_share}");
        }
    }

    #[test]
    fn a_share_of_zero_keeps_every_piece() {
        let mut mesh = two_components();
        assert_eq!(drop_small_components(&mut mesh, 0.0), 0);
        assert_eq!((count_components(&mesh), mesh.vertices.len()), (2, 6));
    }

    #[test]
    fn an_empty_mesh_has_no_components() {
        let mut mesh = Mesh::default();
        assert_eq!((drop_small_components(&mut mesh, 0.5), count_components(&mesh)), (0, 0));
    }
}
