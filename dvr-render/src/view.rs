//! Images of a field: what a camera would see.

use burn::tensor::Tensor;
use dvr_core::{Camera, DepthMap, Mask, Ray, UnitCube};
use image::{GrayImage, Rgb32FImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::field::{Field, Query};
use crate::march::{MarchSettings, Marcher, TensorMarcher};
use crate::rays::Rays;
use crate::skip::SkipGrid;

/// How a view is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RenderSettings {
    /// Samples across the *whole* cube; a ray that may only meet the object in a part of it gets its share.
    pub march: MarchSettings,
    /// Rays in flight at once, a thread.
    pub max_rays: usize,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self { march: MarchSettings::default(), max_rays: 2048 }
    }
}

/// What a camera sees of a field.
#[derive(Clone, Debug)]
pub struct Rendering {
    /// sRGB colours in `[0, 1]`; white where nothing is hit.
    pub color: Rgb32FImage,
    /// 255 where the object is hit.
    pub mask: Mask,
    /// z-depth in object units; `+inf` where nothing is hit.
    pub depth: DepthMap,
    /// Outward unit normals in object space; 0 where nothing is hit.
    pub normal: Rgb32FImage,
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

/// Renders what `camera` sees. `field` must not track gradients.
pub fn render_view(
    field: &impl Field,
    camera: &Camera,
    settings: &RenderSettings,
    skip: Option<&SkipGrid>,
) -> Rendering {
    let (width, height) = (camera.width, camera.height);
    let rays: Vec<Ray> =
        (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| camera.pixel_ray(u, v)).collect();
    let shaded = shade_rays(field, &rays, settings, skip);
    let mut rendering = Rendering {
        color: Rgb32FImage::from_pixel(width, height, image::Rgb([1.0; 3])),
        mask: Mask { coverage: GrayImage::new(width, height) },
        depth: DepthMap { width, height, z_depth: vec![f32::INFINITY; rays.len()] },
        normal: Rgb32FImage::new(width, height),
    };
    for (i, shaded) in shaded.into_iter().enumerate() {
        if let Some(shaded) = shaded {
            let (u, v) = (i as u32 % width, i as u32 / width);
            rendering.color.put_pixel(u, v, image::Rgb(shaded.color));
            rendering.normal.put_pixel(u, v, image::Rgb(shaded.normal));
            rendering.mask.coverage.put_pixel(u, v, image::Luma([255]));
            rendering.depth.z_depth[i] = shaded.depth;
        }
    }
    rendering
}

/// What each ray sees, `None` where it hits nothing. `field` must not track gradients.
pub fn shade_rays(
    field: &impl Field,
    rays: &[Ray],
    settings: &RenderSettings,
    skip: Option<&SkipGrid>,
) -> Vec<Option<Shaded>> {
    let cube = UnitCube::default();
    let whole = 2.0 * cube.half_extent();
    // Rays of like length share a batch, so that each batch can take as few samples as its longest ray needs.
    let mut jobs: Vec<(usize, f64, f64, usize)> = rays
        .iter()
        .enumerate()
        .filter_map(|(i, ray)| {
            let (entry, exit) = match skip {
                Some(skip) => skip.interval(ray),
                None => cube.intersect(ray),
            }?;
            let share = (exit - entry) * ray.direction.length() / whole;
            // Round up to powers of two: few different batch shapes.
            let steps = ((settings.march.steps as f64 * share).ceil() as usize).clamp(4, settings.march.steps);
            Some((i, entry, exit, if skip.is_some() { steps.next_power_of_two() } else { settings.march.steps }))
        })
        .collect();
    jobs.sort_by_key(|&(i, _, _, steps)| (steps, i));
    let batches: Vec<&[(usize, f64, f64, usize)]> =
        jobs.chunk_by(|a, b| a.3 == b.3).flat_map(|group| group.chunks(settings.max_rays)).collect();
    let shaded: Vec<(usize, Shaded)> = batches
        .into_par_iter()
        .flat_map_iter(|batch| {
            let cut: Vec<_> = batch.iter().map(|&(i, entry, exit, _)| (rays[i], entry, exit)).collect();
            let march = MarchSettings { steps: batch[0].3, ..settings.march };
            shade_batch(field, &Rays::within(&cut, &field.device()), march)
                .into_iter()
                .map(|(ray, shaded)| (batch[ray].0, shaded))
        })
        .collect();
    let mut result = vec![None; rays.len()];
    for (i, value) in shaded {
        result[i] = Some(value);
    }
    result
}

/// Marches one batch and evaluates colour and normal at its hits: `(ray, what it sees)`.
fn shade_batch(field: &impl Field, rays: &Rays, settings: MarchSettings) -> Vec<(usize, Shaded)> {
    let Some(hits) = TensorMarcher::new(field, settings).march(rays, None).hits else { return Vec::new() };
    let query: Query = hits.query();
    let floats = |t: Tensor<2>| t.into_data().iter::<f32>().collect::<Vec<_>>();
    let color = floats(field.evaluate(&query).color);
    let gradient = floats(field.occupancy_gradient(&query));
    let depth: Vec<f32> = hits.depth.into_data().iter::<f32>().collect();
    let index: Vec<i64> = hits.index.into_data().iter::<i64>().collect();
    let triple = |values: &[f32], i: usize| [values[3 * i], values[3 * i + 1], values[3 * i + 2]];
    (0..depth.len())
        .map(|i| {
            let normal = (-glam::Vec3::from(triple(&gradient, i))).normalize_or_zero();
            let shaded = Shaded { depth: depth[i], color: triple(&color, i), normal: normal.to_array() };
            (index[i] as usize, shaded)
        })
        .collect()
}
