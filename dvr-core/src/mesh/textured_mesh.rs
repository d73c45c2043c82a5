//! A mesh with materials and textures, as modellers make them.

use std::sync::Arc;

use glam::{DVec3, Vec2};

use super::normal_map::NormalMap;
use super::triangle_mesh::Mesh;
use crate::camera::Similarity;
use crate::error::{Error, Result};

/// How a face of a [`TexturedMesh`] is coloured.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Base colour, sRGB in `[0, 1]`; multiplies the texture where there is one.
    pub base_color: [f32; 3],
    /// Base colour texture, sRGB; texture coordinate (0, 0) is its *bottom* left corner, and it repeats.
    pub texture: Option<Arc<image::RgbaImage>>,
}

impl Material {
    /// The material of meshes that bring their colours in the vertices: white, so that it leaves them as they are.
    pub(super) fn white() -> Self {
        Self { base_color: [1.0; 3], texture: None }
    }
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
    /// Normals finer than those of the vertices, of a mesh with one material; readers leave them out.
    pub normal_map: Option<NormalMap>,
}

impl From<Mesh> for TexturedMesh {
    /// Without a texture.
    fn from(mesh: Mesh) -> Self {
        Self { mesh, ..Self::default() }
    }
}

impl TexturedMesh {
    /// The mesh moved through a similarity, as [`Mesh::transformed`].
    pub fn transformed(self, similarity: &Similarity) -> Self {
        let normal_map = self.normal_map.map(|map| map.rotated(similarity));
        Self { mesh: self.mesh.transformed(similarity), normal_map, ..self }
    }

    /// The mesh in an object space of its own, its longest edge `edge`, and the way back to its own units.
    ///
    /// # Errors
    /// [`Error::NoExtent`] where the faces have no extent.
    pub fn normalized(self, edge: f64) -> Result<(Self, Similarity)> {
        // Vertices that no face uses are not to be seen.
        let used = || self.mesh.faces.iter().flatten().map(|&i| self.mesh.vertices[i as usize].as_dvec3());
        let low = used().fold(DVec3::INFINITY, DVec3::min);
        let high = used().fold(DVec3::NEG_INFINITY, DVec3::max);
        let longest = (high - low).max_element();
        if !longest.is_finite() || longest <= 0.0 {
            return Err(Error::NoExtent { faces: self.mesh.faces.len() });
        }
        let object_to_world =
            Similarity { scale: longest / edge, translation: 0.5 * (low + high), ..Similarity::default() };
        Ok((self.transformed(&object_to_world.inverse()), object_to_world))
    }
}
