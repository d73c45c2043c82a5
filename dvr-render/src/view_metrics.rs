//! How well a field, or a mesh, explains views that it was not made from.

use crate::shade::Shader;
use dvr_core::metrics::picture::psnr_of_error;
use dvr_core::{Exposure, Ray, View};
use serde::{Deserialize, Serialize};

/// Agreement with the pixels of views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewMetrics {
    /// Peak signal-to-noise ratio in dB, both pictures on white.
    pub psnr: f64,
    /// Intersection over union of the silhouettes.
    pub mask_iou: f64,
    /// How many pixels were compared.
    pub pixels: usize,
}

/// Compares what a shader shows with views on an even subset of at most about `max_pixels` of their pixels; `None`
/// without views. The object is where masks as given say; views without a mask are left out. A view whose exposure is
/// not known ([`View::exposure`]) is compared at its own, which one half of its pixels tells, on the other half.
pub fn view_metrics(shader: &dyn Shader, views: &[&View], max_pixels: usize) -> Option<ViewMetrics> {
    compare(shader, views, max_pixels, |view| view.exposure.is_none())
}

/// The same, with the exposure of no view known.
pub fn view_metrics_at_own_exposure(shader: &dyn Shader, views: &[&View], max_pixels: usize) -> Option<ViewMetrics> {
    compare(shader, views, max_pixels, |_| true)
}

/// Compares; `has_own` says which views are compared at their own exposure.
fn compare(
    shader: &dyn Shader,
    views: &[&View],
    max_pixels: usize,
    has_own: impl Fn(&View) -> bool,
) -> Option<ViewMetrics> {
    let views: Vec<&View> = views.iter().copied().filter(|view| view.mask.is_some()).collect();
    let pixels = pixel_subset(&views, max_pixels);
    let rays: Vec<Ray> = pixels.iter().map(|&(view, u, v)| views[view].camera.pixel_ray(u, v)).collect();
    let shaded = shader.shade(&rays);
    let mut telling = vec![Vec::new(); views.len()];
    for (&(view, u, v), shaded) in pixels.iter().zip(&shaded) {
        if let Some(shaded) = shaded
            && Exposure::is_told_by(u, v)
            && views[view].is_object(u, v)
        {
            telling[view].push((color(views[view], u, v), shaded.color));
        }
    }
    let exposure = |(view, telling): (&&View, &Vec<_>)| has_own(view).then(|| Exposure::between(telling));
    let exposures: Vec<Option<Exposure>> = views.iter().zip(&telling).map(exposure).collect();
    let (mut squared, mut count, mut intersection, mut union) = (0.0, 0usize, 0usize, 0usize);
    for (&(view, u, v), predicted) in pixels.iter().zip(shaded) {
        let object = views[view].is_object(u, v);
        let truth = if object { color(views[view], u, v) } else { [1.0; 3] };
        let shown = predicted.map_or([1.0; 3], |shaded| match exposures[view] {
            Some(exposure) => exposure.photographed(shaded.color),
            None => shaded.color,
        });
        if exposures[view].is_none() || !Exposure::is_told_by(u, v) {
            squared += truth.iter().zip(shown).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / 3.0;
            count += 1;
        }
        intersection += usize::from(object && predicted.is_some());
        union += usize::from(object || predicted.is_some());
    }
    (count > 0).then(|| ViewMetrics {
        psnr: psnr_of_error(squared / count as f64),
        mask_iou: if union == 0 { 1.0 } else { intersection as f64 / union as f64 },
        pixels: count,
    })
}

/// A pixel's colour.
fn color(view: &View, u: u32, v: u32) -> [f32; 3] {
    view.image.get_pixel(u, v).0.map(|c| f32::from(c) / 255.0)
}

/// Every `k`-th pixel of all views together, in a fixed order; `k` is odd so that it does not fall on one column.
fn pixel_subset(views: &[&View], max_pixels: usize) -> Vec<(usize, u32, u32)> {
    let total: usize = views.iter().map(|v| v.image.width() as usize * v.image.height() as usize).sum();
    let stride = total.div_ceil(max_pixels.max(1)).max(1) | 1;
    views
        .iter()
        .enumerate()
        .flat_map(|(i, view)| {
            let (width, height) = view.image.dimensions();
            (0..height).flat_map(move |v| (0..width).map(move |u| (i, u, v)))
        })
        .step_by(stride)
        .collect()
}
