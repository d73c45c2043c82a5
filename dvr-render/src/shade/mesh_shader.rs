//! A mesh, traced.

use dvr_core::mesh::{Mesh, TexturedMesh};
use dvr_core::{Bvh, Ray, RayHit, linear_to_srgb};
use glam::Vec3;
use rayon::prelude::*;

use crate::shade::shader::{Shaded, Shader};

/// A mesh in object space, unlit: with its materials and textures, or its vertex colours; white where it has neither.
#[derive(Debug)]
pub struct MeshShader<'a> {
    mesh: &'a Mesh,
    textured: Option<&'a TexturedMesh>,
    bvh: Bvh,
}

impl<'a> MeshShader<'a> {
    /// A mesh with vertex colours, which are interpolated as sRGB. Builds the hierarchy that finds hits.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, textured: None, bvh: Bvh::new(mesh) }
    }

    /// A mesh with materials and textures, whose light is interpolated.
    pub fn textured(textured: &'a TexturedMesh) -> Self {
        Self { textured: Some(textured), ..Self::new(&textured.mesh) }
    }

    fn shade_ray(&self, ray: &Ray) -> Option<Shaded> {
        let hit = self.bvh.closest_hit(ray, 0.0, f64::INFINITY)?;
        let [a, b, c] = self.mesh.triangle(hit.face as usize);
        let normal = match &self.mesh.normals {
            Some(normals) => self.blend(&hit, |i| normals[i]),
            None => (b - a).cross(c - a),
        };
        let normal = normal.normalize_or_zero().to_array();
        Some(Shaded { depth: hit.ray_depth as f32, color: self.color(&hit), normal })
    }

    fn color(&self, hit: &RayHit) -> [f32; 3] {
        let face = hit.face as usize;
        match (self.textured.filter(|textured| textured.material(face).is_some()), &self.mesh.colors) {
            (Some(textured), _) => textured.base_color(face, hit.barycentric).to_array().map(linear_to_srgb),
            (None, Some(colors)) => self.blend(hit, |i| colors[i].into()).to_array(),
            (None, None) => [1.0; 3],
        }
    }

    /// What the corners of the face have, at the hit.
    fn blend(&self, hit: &RayHit, values: impl Fn(usize) -> Vec3) -> Vec3 {
        let corners = self.mesh.faces[hit.face as usize].map(|i| i as usize);
        let weights = hit.barycentric.map(|weight| weight as f32);
        (0..3).map(|k| values(corners[k]) * weights[k]).sum()
    }
}

impl Shader for MeshShader<'_> {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        rays.par_iter().map(|ray| self.shade_ray(ray)).collect()
    }
}
