//! Triangle meshes: what extraction writes and what the dataset renderer reads.

mod accessor;
mod glb;
mod gltf;
mod gltf_material;
mod io;
mod mtl;
mod obj;
mod off;
mod pieces;
mod ply;
mod polygon;
pub mod shapes;
mod simplify;
mod topology;

use std::sync::Arc;

use glam::{Vec2, Vec3};

pub use io::{read_mesh, read_mesh_with_warnings, write_mesh};
pub use pieces::face_pieces;
pub use topology::Topology;

use crate::camera::Similarity;
use crate::visibility::Observation;

/// A triangle mesh. Faces wind counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub vertices: Vec<Vec3>,
    /// Vertex indices, three a triangle.
    pub faces: Vec<[u32; 3]>,
    /// Outward unit normals, one a vertex.
    pub normals: Option<Vec<Vec3>>,
    /// sRGB colours in `[0, 1]`, one a vertex.
    pub colors: Option<Vec<[f32; 3]>>,
    /// How well the photographs that a mesh was made from see it, one a vertex.
    pub observations: Option<Vec<Observation>>,
}

impl Mesh {
    /// Whether there is nothing to see.
    pub fn is_empty(&self) -> bool {
        self.faces.is_empty()
    }

    /// The corners of a face.
    pub fn triangle(&self, face: usize) -> [Vec3; 3] {
        self.faces[face].map(|i| self.vertices[i as usize])
    }

    /// Smallest and largest coordinates of the vertices, or `None` for a mesh without any.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let first = *self.vertices.first()?;
        Some(self.vertices.iter().fold((first, first), |(low, high), &v| (low.min(v), high.max(v))))
    }

    /// Edges that are not shared by exactly two faces that wind the same way; a watertight mesh has none.
    pub fn open_edges(&self) -> usize {
        Topology::of(self).open_edges
    }

    /// The mesh in the world of the files: positions through the similarity, normals rotated.
    pub fn transformed(mut self, similarity: &Similarity) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = similarity.transform_point_f32(*v));
        if let Some(normals) = &mut self.normals {
            normals.iter_mut().for_each(|n| *n = similarity.transform_direction(*n));
        }
        self
    }
}

/// How a face of a [`TexturedMesh`] is coloured.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Base colour, sRGB in `[0, 1]`; multiplies the texture where there is one.
    pub base_color: [f32; 3],
    /// Base colour texture, sRGB; texture coordinate (0, 0) is its *bottom* left corner, and it repeats.
    pub texture: Option<Arc<image::RgbaImage>>,
}

impl Default for Material {
    /// Mid grey, the usual colour of geometry without a material.
    fn default() -> Self {
        Self { base_color: [0.7; 3], texture: None }
    }
}

/// A mesh as modellers make them: materials and textures per face. Vertex colours, where present, multiply.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexturedMesh {
    /// Geometry and vertex colours.
    pub mesh: Mesh,
    /// Texture coordinates of a face's three corners; empty where the file has none.
    pub corner_uvs: Vec<[Vec2; 3]>,
    /// Material of each face, an index into `materials`; empty means material 0 for all.
    pub face_materials: Vec<u32>,
    /// The materials; empty means [`Material::default`].
    pub materials: Vec<Material>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_closed_mesh_has_no_open_edge_and_one_with_a_hole_has_those_around_it() {
        let mut ball = shapes::icosphere(2, 1.0);
        assert_eq!(ball.open_edges(), 0);
        ball.faces.pop();
        assert_eq!(ball.open_edges(), 3);
        let turned = ball.faces[0];
        ball.faces[0] = [turned[0], turned[2], turned[1]];
        assert_eq!(ball.open_edges(), 6, "a face that winds the other way has no neighbours");
    }
}
