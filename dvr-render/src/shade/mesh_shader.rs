//! A mesh, traced.

use dvr_core::mesh::Mesh;
use dvr_core::{Bvh, Ray};
use glam::Vec3;
use rayon::prelude::*;

use crate::shade::shader::{Shaded, Shader};

/// A mesh in object space with vertex colours, unlit; white where it has none.
#[derive(Debug)]
pub struct MeshShader<'a> {
    mesh: &'a Mesh,
    bvh: Bvh,
}

impl<'a> MeshShader<'a> {
    /// Builds the hierarchy that finds hits.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, bvh: Bvh::new(mesh) }
    }

    fn shade_ray(&self, ray: &Ray) -> Option<Shaded> {
        let hit = self.bvh.closest_hit(ray, 0.0, f64::INFINITY)?;
        let corners = self.mesh.faces[hit.face as usize].map(|i| i as usize);
        let weights = hit.barycentric.map(|weight| weight as f32);
        let blend = |values: &dyn Fn(usize) -> Vec3| -> Vec3 { (0..3).map(|k| values(corners[k]) * weights[k]).sum() };
        let color = match &self.mesh.colors {
            Some(colors) => blend(&|i| colors[i].into()).to_array(),
            None => [1.0; 3],
        };
        let [a, b, c] = self.mesh.triangle(hit.face as usize);
        let normal = match &self.mesh.normals {
            Some(normals) => blend(&|i| normals[i]),
            None => (b - a).cross(c - a),
        };
        Some(Shaded { depth: hit.ray_depth as f32, color, normal: normal.normalize_or_zero().to_array() })
    }
}

impl Shader for MeshShader<'_> {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        rays.par_iter().map(|ray| self.shade_ray(ray)).collect()
    }
}
