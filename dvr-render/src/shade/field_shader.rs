//! A field, marched.

use burn::tensor::Tensor;
use dvr_core::{Ray, UnitCube};
use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::chunks::{in_parallel, points_at_once};
use crate::extract::{FieldSurface, ScalarField};
use crate::field::Crossing;
use crate::march::{Hits, MarchSettings, Rays};
use crate::shade::shader::{Shaded, Shader};
use crate::skip::SkipGrid;

/// How a field is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Samples across the *whole* cube; a ray that may only meet the object in a part of it gets its share.
    pub march: MarchSettings,
    /// Rays in flight at once per thread of a CPU; on a GPU, its memory says how many.
    pub max_rays: usize,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { march: MarchSettings::default(), max_rays: 2048 }
    }
}

/// A field as rays see it: through its own renderer where it has one, else marched. Colours are asked with the rays'
/// directions.
pub struct FieldShader<'a, F: ?Sized> {
    surface: FieldSurface<&'a F>,
    settings: RenderSettings,
    skip: Option<&'a SkipGrid>,
}

impl<'a, F: Crossing + ?Sized> FieldShader<'a, F> {
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
        let query = hits.query();
        let points = vectors(query.points);
        let directions = query.directions.map(vectors);
        // A snapshot of a field answers both.
        let gradients = self.surface.gradients(&points).unwrap_or_else(|| vec![Vec3::ZERO; points.len()]);
        let normals: Vec<Vec3> = gradients.into_iter().map(|gradient| (-gradient).normalize_or_zero()).collect();
        let colors = self
            .surface
            .colors(&points, &normals, directions.as_deref())
            .unwrap_or_else(|| vec![[1.0; 3]; points.len()]);
        let depth = hits.depth.into_data();
        let index = hits.index.into_data();
        index
            .iter::<i64>()
            .zip(depth.iter::<f32>())
            .zip(colors.into_iter().zip(normals))
            .map(|((ray, depth), (color, normal))| (ray as usize, Shaded { depth, color, normal: normal.to_array() }))
            .collect()
    }

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

/// A ray to march: its index, the depths between which it may meet the object, and its samples.
#[derive(Clone, Copy)]
struct Job {
    ray: usize,
    entry: f64,
    exit: f64,
    steps: usize,
}

impl<F: Crossing + ?Sized> FieldShader<'_, F> {
    /// How ray number `index` is marched; `None` where it cannot meet the object.
    fn job(&self, index: usize, ray: &Ray) -> Option<Job> {
        let (cube, most) = (UnitCube::default(), self.settings.march.steps);
        let Some(skip) = self.skip else {
            let (entry, exit) = cube.intersect(ray)?;
            return Some(Job { ray: index, entry, exit, steps: most });
        };
        let (entry, exit) = skip.interval(ray)?;
        let share = (exit - entry) * ray.direction.length() / (2.0 * cube.half_extent());
        let steps = ((most as f64 * share).ceil() as usize).clamp(4.min(most), most);
        // Round up to powers of two: few different batch shapes.
        Some(Job { ray: index, entry, exit, steps: steps.next_power_of_two() })
    }
}

impl<F: Crossing + ?Sized> Shader for FieldShader<'_, F> {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        if let Some(own) = self.surface.field().own_shader() {
            return own.shade(rays);
        }
        let device = self.surface.field().device();
        let mut jobs: Vec<Job> = rays.iter().enumerate().filter_map(|(i, ray)| self.job(i, ray)).collect();
        // Rays of like length share a batch, so that each batch can take as few samples as its longest ray needs.
        jobs.sort_by_key(|job| (job.steps, job.ray));
        let rays_per_batch = points_at_once(&device, self.settings.max_rays);
        let batches: Vec<&[Job]> =
            jobs.chunk_by(|a, b| a.steps == b.steps).flat_map(|group| group.chunks(rays_per_batch)).collect();
        let shaded = in_parallel(&device, batches, |batch: &[Job]| {
            let cut: Vec<_> = batch.iter().map(|job| (rays[job.ray], job.entry, job.exit)).collect();
            let march = MarchSettings { steps: batch[0].steps, ..self.settings.march };
            let shaded = self.shade_batch(&Rays::within(&cut, &device), march).into_iter();
            shaded.map(|(place, shaded)| (batch[place].ray, shaded)).collect::<Vec<_>>()
        });
        let mut result = vec![None; rays.len()];
        for (ray, value) in shaded.into_iter().flatten() {
            result[ray] = Some(value);
        }
        result
    }
}

/// Rows of an `[n, 3]` tensor.
fn vectors(tensor: Tensor<2>) -> Vec<Vec3> {
    let flat: Vec<f32> = tensor.into_data().iter::<f32>().collect();
    flat.as_chunks().0.iter().map(|&v| Vec3::from_array(v)).collect()
}
