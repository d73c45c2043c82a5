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

    /// Adds a vertex half way between two, with the mean of what is known of them; where photographs saw them, as the first
    /// was seen. Returns its index.
    pub(super) fn push_middle(&mut self, a: u32, b: u32) -> u32 {
        let (a, b) = (a as usize, b as usize);
        self.vertices.push((self.vertices[a] + self.vertices[b]) / 2.0);
        if let Some(normals) = &mut self.normals {
            normals.push((normals[a] + normals[b]).normalize_or(normals[a]));
        }
        if let Some(colors) = &mut self.colors {
            colors.push([0, 1, 2].map(|c| (colors[a][c] + colors[b][c]) / 2.0));
        }
        if let Some(observations) = &mut self.observations {
            observations.push(observations[a]);
        }
        self.vertices.len() as u32 - 1
    }

    /// The mesh with faces in an order in which graphics cards find vertices again, and vertices in that of the faces; and which
    /// vertex each was. Vertices that no face uses are dropped.
    pub(super) fn in_drawing_order(&self) -> (Self, Vec<usize>) {
        let is_sound = self.faces.as_flattened().iter().all(|&corner| (corner as usize) < self.vertices.len());
        assert!(is_sound, "a face has a vertex that the mesh has not");
        let mut corners = meshopt::optimize_vertex_cache(self.faces.as_flattened(), self.vertices.len());
        let (mut numbers, mut sources) = (vec![u32::MAX; self.vertices.len()], Vec::new());
        for corner in &mut corners {
            let number = &mut numbers[*corner as usize];
            if *number == u32::MAX {
                *number = sources.len() as u32;
                sources.push(*corner as usize);
            }
            *corner = *number;
        }
        (self.with_vertices(&sources, corners.as_chunks().0.to_vec()), sources)
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
