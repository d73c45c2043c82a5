//! One vertex a place, where files have several.

use std::collections::HashMap;

use super::triangle_mesh::Mesh;

/// The mesh with one vertex for all that lie at exactly one place, where edges that were open are closed by that: along
/// the seams of an atlas, say. What is known of the first of them is kept. Any other mesh is returned as it is: parts of a
/// closed one that touch stay apart.
pub(super) fn welded(mesh: &Mesh) -> Mesh {
    let open = mesh.open_edges();
    if open == 0 {
        return mesh.clone();
    }
    let mut known: HashMap<[u32; 3], u32> = HashMap::with_capacity(mesh.vertices.len());
    let mut sources = Vec::new();
    let numbers: Vec<u32> = (mesh.vertices.iter().enumerate())
        .map(|(vertex, place)| {
            // Minus zero is the same place as zero.
            *known.entry((*place + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                sources.push(vertex);
                sources.len() as u32 - 1
            })
        })
        .collect();
    let faces = mesh.faces.iter().map(|face| face.map(|vertex| numbers[vertex as usize]));
    let faces: Vec<[u32; 3]> = faces.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let one = mesh.with_vertices(&sources, faces);
    if one.open_edges() < open { one } else { mesh.clone() }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::shapes;
    use super::*;

    #[test]
    fn faces_that_share_no_vertex_become_the_surface_that_they_are() {
        let ball = shapes::icosphere(2, 1.0);
        let mut soup = Mesh::default();
        for face in 0..ball.faces.len() {
            soup.faces.push([0, 1, 2].map(|k| 3 * face as u32 + k));
            soup.vertices.extend(ball.triangle(face));
        }
        soup.vertices.iter_mut().filter(|v| v.x == 0.0).for_each(|v| v.x = -v.x);
        let one = welded(&soup);
        assert_eq!((one.open_edges(), one.vertices.len()), (0, ball.vertices.len()));
    }

    #[test]
    fn parts_that_touch_stay_apart() {
        let cube = |low: f32| shapes::cuboid(Vec3::splat(low), Vec3::splat(low + 1.0));
        let touching = shapes::union([cube(0.0), cube(1.0)]);
        assert_eq!(welded(&touching), touching);
    }
}
