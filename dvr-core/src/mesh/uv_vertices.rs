//! Vertices of which each has one texture coordinate, as graphics cards want them.

use std::collections::HashMap;

use glam::{Vec2, Vec4};

use super::textured_mesh::TexturedMesh;
use super::triangle_mesh::Mesh;

/// A mesh whose vertices are split where the texture coordinates of their faces differ: along the seams of an atlas.
#[derive(Clone, Debug)]
pub struct UvVertices {
    /// The split mesh; faces in the same order.
    pub mesh: Mesh,
    /// Texture coordinates, one per vertex; (0, 0) is the texture's bottom left corner.
    pub uvs: Vec<Vec2>,
}

impl UvVertices {
    /// Splits the vertices of a mesh; faces without texture coordinates get (0, 0).
    pub fn of(textured: &TexturedMesh) -> Self {
        Self::split(textured, |_, _| Vec4::ZERO).0
    }

    /// The same, with vertices split where tangents differ, too. Returns the tangents, one per vertex.
    pub(super) fn with_tangents(textured: &TexturedMesh, tangents: &[[Vec4; 3]]) -> (Self, Vec<Vec4>) {
        Self::split(textured, |face, corner| tangents.get(face).map_or(Vec4::ZERO, |tangents| tangents[corner]))
    }

    fn split(textured: &TexturedMesh, tangent: impl Fn(usize, usize) -> Vec4) -> (Self, Vec<Vec4>) {
        let mesh = &textured.mesh;
        let mut known: HashMap<(u32, [u32; 2], [u32; 4]), u32> = HashMap::with_capacity(mesh.vertices.len());
        let (mut sources, mut uvs, mut tangents) = (Vec::new(), Vec::new(), Vec::new());
        let mut faces = Vec::with_capacity(mesh.faces.len());
        for (index, face) in mesh.faces.iter().enumerate() {
            let corner_uvs = textured.corner_uvs.get(index).copied().unwrap_or_default();
            faces.push([0, 1, 2].map(|k| {
                let (vertex, uv, tangent) = (face[k], corner_uvs[k], tangent(index, k));
                let key = (vertex, uv.to_array().map(f32::to_bits), tangent.to_array().map(f32::to_bits));
                *known.entry(key).or_insert_with(|| {
                    sources.push(vertex as usize);
                    uvs.push(uv);
                    tangents.push(tangent);
                    sources.len() as u32 - 1
                })
            }));
        }
        (Self { mesh: mesh.with_vertices(&sources, faces), uvs }, tangents)
    }
}

#[cfg(test)]
mod tests {
    use super::super::shapes;
    use super::*;

    #[test]
    fn a_vertex_on_a_seam_is_split_and_the_others_are_not() {
        let mut mesh = shapes::icosphere(1, 0.4);
        mesh.colors = Some(vec![[0.1, 0.2, 0.3]; mesh.vertices.len()]);
        let seam = |face: usize| f32::from(u8::from(face == 0));
        let corner_uvs = (0..mesh.faces.len()).map(|face| [Vec2::splat(seam(face)); 3]).collect();
        let textured = TexturedMesh { mesh: mesh.clone(), corner_uvs, ..TexturedMesh::default() };
        let split = UvVertices::of(&textured);
        assert_eq!(split.mesh.vertices.len(), mesh.vertices.len() + 3, "the corners of the one face");
        assert_eq!(split.uvs.len(), split.mesh.vertices.len());
        for face in 0..mesh.faces.len() {
            assert_eq!(split.mesh.triangle(face), mesh.triangle(face));
            assert!(split.mesh.faces[face].iter().all(|&i| split.uvs[i as usize] == Vec2::splat(seam(face))));
        }
        assert_eq!(split.mesh.colors.unwrap().len(), split.uvs.len());
        assert_eq!(split.mesh.normals.unwrap().len(), split.uvs.len());
    }
}
