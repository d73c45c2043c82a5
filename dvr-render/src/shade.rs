//! What rays see: the common view of fields and meshes.

use burn::tensor::Tensor;
use dvr_core::mesh::Mesh;
use dvr_core::{Bvh, Ray, UnitCube};
use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::chunks::{in_parallel, points_at_once};
use crate::extract::{FieldSurface, ScalarField};
use crate::field::Field;
use crate::march::{Hits, MarchSettings};
use crate::rays::Rays;
use crate::skip::SkipGrid;

/// Something to look at: a field through its marcher, or a mesh. Pictures, validation and evaluation know nothing else.
pub trait Shader: Sync {
    /// What each ray sees, in the rays' order; `None` where it sees nothing.
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>>;
}

impl<S: Shader + ?Sized> Shader for &S {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        (**self).shade(rays)
    }
}

/// What one ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaded {
    /// Ray depth.
    pub depth: f32,
    /// sRGB colour in `[0, 1]`.
    pub color: [f32; 3],
    /// Outward unit normal.
    pub normal: [f32; 3],
}

/// How a field is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Samples across the *whole* cube; a ray that may only meet the object in a part of it gets its share.
    pub march: MarchSettings,
    /// Rays in flight at once, a thread of a CPU; on a GPU, its memory says how many.
    pub max_rays: usize,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { march: MarchSettings::default(), max_rays: 2048 }
    }
}

/// A field, marched.
pub struct FieldShader<'a, F> {
    surface: FieldSurface<&'a F>,
    settings: RenderSettings,
    skip: Option<&'a SkipGrid>,
}

impl<'a, F: Field> FieldShader<'a, F> {
    /// A field that must not track gradients, searched in the whole cube or in what `skip` leaves of it.
    pub fn new(field: &'a F, settings: RenderSettings, skip: Option<&'a SkipGrid>) -> Self {
        Self { surface: FieldSurface::new(field), settings, skip }
    }

    /// Marches one batch and evaluates colour and normal at its hits: `(ray, what it sees)`.
    fn shade_batch(&self, rays: &Rays, settings: MarchSettings) -> Vec<(usize, Shaded)> {
        let Some(hits) = self.surface.marcher(settings).march(rays, None).hits else { return Vec::new() };
        if self.surface.asks_tensors() {
            return self.shade_on_device(&hits);
        }
        let flat: Vec<f32> = hits.points().into_data().iter::<f32>().collect();
        let points: Vec<Vec3> = flat.as_chunks().0.iter().map(|&p| Vec3::from_array(p)).collect();
        // A field answers both: what has no gradient or colour is no `Field`.
        let gradients = self.surface.gradients(&points).unwrap_or_else(|| vec![Vec3::ZERO; points.len()]);
        let normals: Vec<Vec3> = gradients.into_iter().map(|gradient| (-gradient).normalize_or_zero()).collect();
        let colors = self.surface.colors(&points, &normals).unwrap_or_else(|| vec![[1.0; 3]; points.len()]);
        let depth = hits.depth.into_data();
        let index = hits.index.into_data();
        index
            .iter::<i64>()
            .zip(depth.iter::<f32>())
            .zip(colors.into_iter().zip(normals))
            .map(|((ray, depth), (color, normal))| (ray as usize, Shaded { depth, color, normal: normal.to_array() }))
            .collect()
    }
}

impl<F: Field> FieldShader<'_, F> {
    /// What the hits show, evaluated where they lie and read back at once.
    fn shade_on_device(&self, hits: &Hits) -> Vec<(usize, Shaded)> {
        let query = hits.query();
        let columns = [
            hits.index.clone().float().unsqueeze_dim::<2>(1),
            hits.depth.clone().unsqueeze_dim(1),
            self.surface.field().evaluate(&query).color,
            self.surface.field().occupancy_gradient(&query),
        ];
        let numbers: Vec<f32> = Tensor::cat(columns.to_vec(), 1).into_data().iter::<f32>().collect();
        let shaded = |&[ray, depth, r, g, b, x, y, z]: &[f32; 8]| {
            let normal = (-Vec3::new(x, y, z)).normalize_or_zero().to_array();
            (ray as usize, Shaded { depth, color: [r, g, b], normal })
        };
        numbers.as_chunks().0.iter().map(shaded).collect()
    }
}

impl<F: Field> Shader for FieldShader<'_, F> {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        let cube = UnitCube::default();
        let device = self.surface.field().device();
        let whole = 2.0 * cube.half_extent();
        // Rays of like length share a batch, so that each batch can take as few samples as its longest ray needs.
        let mut jobs: Vec<(usize, f64, f64, usize)> = rays
            .iter()
            .enumerate()
            .filter_map(|(i, ray)| {
                let (entry, exit) = match self.skip {
                    Some(skip) => skip.interval(ray),
                    None => cube.intersect(ray),
                }?;
                let share = (exit - entry) * ray.direction.length() / whole;
                // Round up to powers of two: few different batch shapes.
                let steps =
                    ((self.settings.march.steps as f64 * share).ceil() as usize).clamp(4, self.settings.march.steps);
                Some((
                    i,
                    entry,
                    exit,
                    if self.skip.is_some() { steps.next_power_of_two() } else { self.settings.march.steps },
                ))
            })
            .collect();
        jobs.sort_by_key(|&(i, _, _, steps)| (steps, i));
        let rays_a_batch = points_at_once(&device, self.settings.max_rays);
        let batches: Vec<&[(usize, f64, f64, usize)]> =
            jobs.chunk_by(|a, b| a.3 == b.3).flat_map(|group| group.chunks(rays_a_batch)).collect();
        let shaded = in_parallel(&device, batches, |batch: &[(usize, f64, f64, usize)]| {
            let cut: Vec<_> = batch.iter().map(|&(i, entry, exit, _)| (rays[i], entry, exit)).collect();
            let march = MarchSettings { steps: batch[0].3, ..self.settings.march };
            let shaded = self.shade_batch(&Rays::within(&cut, &device), march).into_iter();
            shaded.map(|(ray, shaded)| (batch[ray].0, shaded)).collect::<Vec<_>>()
        });
        let mut result = vec![None; rays.len()];
        for (i, value) in shaded.into_iter().flatten() {
            result[i] = Some(value);
        }
        result
    }
}

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
