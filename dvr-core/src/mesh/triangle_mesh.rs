//! A triangle mesh: positions, faces, and what is known per vertex.

use glam::Vec3;

use crate::camera::Similarity;
use crate::observation::Observation;

/// A triangle mesh. Faces wind counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions.
    pub vertices: Vec<Vec3>,
    /// Vertex indices, three per triangle.
    pub faces: Vec<[u32; 3]>,
    /// Outward unit normals, one per vertex.
    pub normals: Option<Vec<Vec3>>,
    /// sRGB colours in `[0, 1]`, one per vertex.
    pub colors: Option<Vec<[f32; 3]>>,
    /// How well the photographs that a mesh was made from see it, one per vertex.
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

    /// The mesh in the world of the files: positions through the similarity, normals rotated.
    pub fn transformed(mut self, similarity: &Similarity) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = similarity.transform_point_f32(*v));
        if let Some(normals) = &mut self.normals {
            normals.iter_mut().for_each(|n| *n = similarity.transform_direction(*n));
        }
        self
    }

    /// Other faces, over copies of these vertices with all that is known of them.
    pub(super) fn with_vertices(&self, sources: &[usize], faces: Vec<[u32; 3]>) -> Self {
        Self {
            vertices: sources.iter().map(|&i| self.vertices[i]).collect(),
            faces,
            normals: self.normals.as_ref().map(|normals| sources.iter().map(|&i| normals[i]).collect()),
            colors: self.colors.as_ref().map(|colors| sources.iter().map(|&i| colors[i]).collect()),
            observations: self.observations.as_ref().map(|seen| sources.iter().map(|&i| seen[i]).collect()),
        }
    }
}
