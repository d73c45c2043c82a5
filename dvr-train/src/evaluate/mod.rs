//! The final figures: shape against the truth, pictures against views that were not trained on.

mod depth_maps;
mod points;

pub use depth_maps::DepthMapsEvaluation;
pub use points::PointsEvaluation;

use dvr_core::inside::points_inside;
use dvr_core::mesh::Mesh;
use dvr_core::metrics::intersection_over_union;
use dvr_core::metrics::picture::{mask_iou, psnr, ssim};
use dvr_core::metrics::seen::{SeenScore, score_seen};
use dvr_core::metrics::shape::{F_SCORE_THRESHOLDS, SURFACE_SAMPLES, ShapeScore, cloud_floor, score_surface};
use dvr_core::sampling::sample_surface;
use dvr_core::{Camera, Cancellation, Exposure, GroundTruth, Mask, PointCloud, View};
use dvr_render::{Rendering, Shader, render_view};
use glam::Vec3;
use image::{GrayImage, Luma};
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::export::preview::{to_rgb8, whitened};

/// A shape against the truth. Lengths are in units of the object cube.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShapeEvaluation {
    /// Distances, normals and F-scores, where the true surface is known.
    pub surface: Option<ShapeScore>,
    /// What the true surface, sampled twice, scores: no reconstruction can be measured to be better.
    pub floor: Option<ShapeScore>,
    /// Volume IoU on points of the cube, where the true occupancy is known.
    pub volume_iou: Option<f64>,
    /// The surface again, where at least two views see it; `None` where that is not known.
    #[serde(default)]
    pub seen: Option<SeenScore>,
}

/// Renders of one view against its photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewEvaluation {
    /// The view's name.
    pub view: String,
    /// PSNR in dB, both pictures on white.
    pub psnr: f64,
    /// Structural similarity, both pictures on white.
    pub ssim: f64,
    /// IoU of the silhouettes.
    pub mask_iou: f64,
}

/// Scores a mesh in object space, which may be empty: as a whole, and where at least two of `cameras` see it.
///
/// # Errors
/// When the truth is broken (points that are not finite).
pub fn evaluate_shape(mesh: &Mesh, truth: &GroundTruth, cameras: &[&Camera], seed: u64) -> Result<ShapeEvaluation> {
    let sampled = || PointCloud::from(sample_surface(mesh, SURFACE_SAMPLES, seed));
    let whole = evaluate_points(sampled, |points| points_inside(mesh, points), truth, seed)?;
    let seen = match &truth.surface {
        Some(cloud) => score_seen(mesh, &sampled(), cloud, cameras, &F_SCORE_THRESHOLDS)?,
        None => None,
    };
    Ok(ShapeEvaluation { seen, ..whole })
}

/// Scores a shape that is given by points sampled from its surface, and by whether points are inside.
///
/// # Errors
/// When the truth, or the shape, is broken (points that are not finite).
pub(crate) fn evaluate_points(
    surface_samples: impl FnOnce() -> PointCloud,
    inside: impl FnOnce(&[Vec3]) -> Vec<bool>,
    truth: &GroundTruth,
    seed: u64,
) -> Result<ShapeEvaluation> {
    let (mut surface, mut floor, mut volume_iou) = (None, None, None);
    if let Some(cloud) = &truth.surface {
        surface = Some(score_surface(&surface_samples(), cloud, &F_SCORE_THRESHOLDS)?);
        floor = Some(cloud_floor(cloud, SURFACE_SAMPLES, &F_SCORE_THRESHOLDS, seed)?);
    }
    if let Some(samples) = &truth.occupancy {
        volume_iou = Some(intersection_over_union(&inside(&samples.points), &samples.inside)?);
    }
    Ok(ShapeEvaluation { surface, floor, volume_iou, seen: None })
}

/// Renders views in full and compares; `progress` hears how many are done. A view whose exposure is not known
/// ([`View::exposure`]) is compared at its own, which one half of its pixels tells; its PSNR is that of the other half.
///
/// # Errors
/// When a view's pictures differ in size; [`crate::Error::Cancelled`] where somebody wants it to end.
pub fn evaluate_views(
    shader: &dyn Shader,
    views: &[&View],
    cancellation: &Cancellation,
    mut progress: impl FnMut(usize),
) -> Result<Vec<ViewEvaluation>> {
    let mut results = Vec::with_capacity(views.len());
    for view in views {
        cancellation.check()?;
        let Some(mask) = &view.mask else { continue };
        let mut rendering = render_view(shader, &view.camera);
        let judging = (view.exposure.is_none()).then(|| expose(&mut rendering, view));
        let (predicted, truth) = (to_rgb8(&rendering.color), whitened(view));
        results.push(ViewEvaluation {
            view: view.name.clone(),
            psnr: psnr(&predicted, &truth, judging.as_ref())?,
            ssim: ssim(&predicted, &truth)?,
            mask_iou: mask_iou(&rendering.mask, mask)?,
        });
        progress(results.len());
    }
    Ok(results)
}

/// Brings what is rendered of the object to the exposure of its photograph, which one half of the pixels tells; returns
/// the other half.
fn expose(rendering: &mut Rendering, view: &View) -> Mask {
    let (width, height) = rendering.color.dimensions();
    let both = |(u, v): (u32, u32)| {
        let is_object = view.is_object(u, v) && rendering.mask.is_object(u, v);
        let shown = || view.image.get_pixel(u, v).0.map(|c| f32::from(c) / 255.0);
        (is_object && Exposure::is_told_by(u, v)).then(|| (shown(), rendering.color.get_pixel(u, v).0))
    };
    let telling: Vec<_> = (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).filter_map(both).collect();
    let exposure = Exposure::between(&telling);
    let mut judging = GrayImage::new(width, height);
    for (u, v, pixel) in rendering.color.enumerate_pixels_mut() {
        if rendering.mask.is_object(u, v) {
            pixel.0 = exposure.photographed(pixel.0);
        }
        judging.put_pixel(u, v, Luma([if Exposure::is_told_by(u, v) { 0 } else { 255 }]));
    }
    judging.into()
}
