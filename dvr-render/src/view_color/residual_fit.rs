//! The small pictures of what photographs show beside a surface.

use dvr_core::{Cancellation, Cancelled, Ray, View};
use glam::{DMat3, DVec2, DVec3, Vec3};
use half::f16;
use rayon::prelude::*;

use super::residual_views::{LEVELS, ResidualView, ResidualViews, tolerance};
use crate::shade::Shader;

/// Pixels of all small pictures together, at most about.
const PIXELS: u64 = 800_000;

/// Rays along each edge of a pixel of a small picture, at most.
const SIDE: u32 = 2;

/// Pixels of small pictures that are looked at before anybody is asked whether to go on.
const BATCH: usize = 1 << 14;

/// Where the object is in a photograph.
struct Extent {
    first: [u32; 2],
    size: [u32; 2],
}

/// One photograph, of whose pixels a few stand for each of larger ones.
struct Shrunk<'a> {
    view: &'a View,
    first: [u32; 2],
    size: [u32; 2],
    /// Pixels of the photograph along the edge of one.
    by: u32,
}

/// What `shader` does not show of photographs, at the mean exposure of the scene.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(super) fn residual_views(
    shader: &dyn Shader,
    views: &[&View],
    cancellation: &Cancellation,
) -> Result<ResidualViews, Cancelled> {
    let of_view = |view: &&View| cancellation.check().map(|()| extent(view));
    let extents: Vec<Option<Extent>> = views.par_iter().map(of_view).collect::<Result<_, Cancelled>>()?;
    let pixels: u64 = extents.iter().flatten().map(|Extent { size: [w, h], .. }| u64::from(*w) * u64::from(*h)).sum();
    let by = (pixels as f64 / PIXELS as f64).sqrt().ceil().max(1.0) as u32;
    let mut found = Vec::with_capacity(views.len());
    for (view, extent) in views.iter().zip(extents) {
        let Some(Extent { first, size }) = extent else { continue };
        let shrunk = Shrunk { view, first, size: size.map(|edge| edge.div_ceil(by)), by };
        found.extend(shrunk.residuals(shader, cancellation)?);
    }
    Ok(ResidualViews(found))
}

/// The pixels around all that show the object; `None` where none does.
fn extent(view: &View) -> Option<Extent> {
    let (width, height) = view.image.dimensions();
    let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    let (mut first, mut last) = ([u32::MAX; 2], [0; 2]);
    for (u, v) in pixels.filter(|&(u, v)| view.is_training_object(u, v)) {
        first = [first[0].min(u), first[1].min(v)];
        last = [last[0].max(u), last[1].max(v)];
    }
    (first[0] <= last[0]).then(|| Extent { first, size: [last[0] - first[0] + 1, last[1] - first[1] + 1] })
}

impl Shrunk<'_> {
    /// `None` where no ray meets the surface.
    fn residuals(&self, shader: &dyn Shader, cancellation: &Cancellation) -> Result<Option<ResidualView>, Cancelled> {
        let [width, height] = self.size;
        let pixels: Vec<[u32; 2]> = (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).collect();
        let (mut depths, mut changes) = (Vec::with_capacity(pixels.len()), Vec::with_capacity(pixels.len()));
        for pixels in pixels.chunks(BATCH) {
            cancellation.check()?;
            let places: Vec<Vec<[u32; 2]>> = pixels.iter().map(|&pixel| self.places(pixel)).collect();
            let rays: Vec<Ray> = places.iter().flatten().map(|&[u, v]| self.view.camera.pixel_ray(u, v)).collect();
            let mut shaded = shader.shade(&rays).into_iter();
            for places in &places {
                let met = places.iter().zip(shaded.by_ref()).filter_map(|(&[u, v], shaded)| {
                    let shaded = shaded?;
                    let shown = Vec3::from(self.view.image.get_pixel(u, v).0.map(f32::from)) / 255.0;
                    let change = self.view.exposure.unwrap_or_default().corrected(shown) - Vec3::from(shaded.color);
                    Some((shaded.depth, change))
                });
                let met: Vec<(f32, Vec3)> = met.collect();
                let (depth, change) = front(&met).unwrap_or_default();
                // What is farther than 16 bits can say is not kept.
                depths.push(Some(f16::from_f32(depth)).filter(|depth| depth.is_finite()).unwrap_or(f16::ZERO));
                changes.push((LEVELS * change).round().to_array().map(|level| level as i8));
            }
        }
        if depths.iter().all(|depth| *depth == f16::ZERO) {
            return Ok(None);
        }
        let (projection, offset) = self.projection();
        Ok(ResidualView::new(self.size, projection.as_mat3(), offset.as_vec3(), depths, changes))
    }

    /// Pixels of the photograph that stand for one of the small picture: those that show the object, and not its outline.
    fn places(&self, pixel: [u32; 2]) -> Vec<[u32; 2]> {
        let side = self.by.min(SIDE);
        let along = |axis: usize, i: u32| self.first[axis] + pixel[axis] * self.by + (2 * i + 1) * self.by / (2 * side);
        let (width, height) = self.view.image.dimensions();
        let places = (0..side).flat_map(|i| (0..side).map(move |j| [along(0, j), along(1, i)]));
        let within = |edge: u32, at: u32| at > 0 && at + 1 < edge;
        let shown = |u: u32, v: u32| self.view.is_training_object(u, v);
        let inner = |u: u32, v: u32| (v - 1..=v + 1).all(|v| (u - 1..=u + 1).all(|u| shown(u, v)));
        places.filter(|&[u, v]| within(width, u) && within(height, v) && inner(u, v)).collect()
    }

    /// From object space to its pixels.
    fn projection(&self) -> (DMat3, DVec3) {
        let camera = &self.view.camera;
        let first = DVec2::from(self.first.map(f64::from));
        let shrink = f64::from(self.by).recip();
        let crop =
            DMat3::from_cols(DVec3::new(shrink, 0.0, 0.0), DVec3::new(0.0, shrink, 0.0), (-shrink * first).extend(1.0));
        let intrinsics = crop * camera.intrinsics;
        (intrinsics * camera.rotation, intrinsics * camera.translation)
    }
}

/// Depth and change of the nearest surface among those that rays of a pixel met.
fn front(met: &[(f32, Vec3)]) -> Option<(f32, Vec3)> {
    let nearest = met.iter().map(|(depth, _)| *depth).min_by(f32::total_cmp)?;
    let (mut count, mut depths, mut changes) = (0.0, 0.0, Vec3::ZERO);
    for (depth, change) in met.iter().filter(|(depth, _)| *depth <= nearest + tolerance(nearest)) {
        (count, depths, changes) = (count + 1.0, depths + depth, changes + *change);
    }
    Some((depths / count, changes / count))
}
