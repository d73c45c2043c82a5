//! The lumigraph of a scene: its photographs, small enough to be kept, with the depths that they saw.

use std::borrow::Cow;
use std::path::Path;

use dvr_core::files::{decoded_picture, encoded_jpeg};
use dvr_core::{Camera, Cancellation, Cancelled, Ray, View};
use glam::{DMat3, Vec3};
use half::f16;
use image::{Rgb, RgbImage};
use rayon::prelude::*;

use super::lumigraph::{Lumigraph, Photograph, nodes};
use crate::shade::Shader;

/// Pixels of all photographs together, at most about: larger ones are kept smaller.
const PIXELS: u64 = 12_000_000;

/// Nodes of depths of all photographs together, at most about.
const NODES: u64 = 800_000;

/// Quality of the JPEGs that they are kept as.
const QUALITY: u8 = 90;

/// Edge of the squares that a JPEG consists of.
const BLOCK: u32 = 8;

/// What is in squares that do not show the object.
const EMPTY: Rgb<u8> = Rgb([128; 3]);

/// The part of a photograph that shows the object.
struct Crop {
    camera: Camera,
    first: [u32; 2],
    size: [u32; 2],
    stored: Vec<u8>,
    /// Pixels from one node of depths to the next.
    spacing: u32,
    /// Whether the photograph shows the object, and not its outline, at each node of depths.
    is_inner: Vec<bool>,
}

/// That of photographs of the surface that `shader` shows, at the mean exposure of the scene.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(super) fn lumigraph(
    shader: &dyn Shader,
    views: &[&View],
    cancellation: &Cancellation,
) -> Result<Lumigraph, Cancelled> {
    let sizes = views.par_iter().filter_map(|view| extent(view)).map(|(_, [w, h])| u64::from(w) * u64::from(h));
    let pixels: u64 = sizes.sum();
    let step = |pixels: u64, most: u64| (pixels as f64 / most as f64).sqrt().ceil().max(1.0) as u32;
    let by = step(pixels, PIXELS);
    let spacing = step(pixels / u64::from(by).pow(2), NODES);
    let of_view = |view: &&View| cancellation.check().map(|()| Crop::of(view, by, spacing));
    let crops: Vec<Option<Crop>> = views.par_iter().map(of_view).collect::<Result<_, Cancelled>>()?;
    let mut with_depths = Vec::with_capacity(crops.len());
    for crop in crops.into_iter().flatten() {
        cancellation.check()?;
        let depths = crop.depths(shader);
        if depths.iter().any(|depth| *depth > f16::ZERO) {
            with_depths.push((crop, depths));
        }
    }
    Ok(Lumigraph(with_depths.into_par_iter().filter_map(|(crop, depths)| crop.photograph(depths)).collect()))
}

/// First pixel and size of what is around all pixels that show the object; `None` where none does.
fn extent(view: &View) -> Option<([u32; 2], [u32; 2])> {
    let (width, height) = view.image.dimensions();
    let pixels = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
    let (mut first, mut last) = ([u32::MAX; 2], [0; 2]);
    for (u, v) in pixels.filter(|&(u, v)| view.is_training_object(u, v)) {
        first = [first[0].min(u), first[1].min(v)];
        last = [last[0].max(u), last[1].max(v)];
    }
    (first[0] <= last[0]).then(|| (first, [last[0] - first[0] + 1, last[1] - first[1] + 1]))
}

impl Crop {
    /// Of a photograph, with one pixel for `by` x `by` of its. `None` where it shows no object then.
    fn of(view: &View, by: u32, spacing: u32) -> Option<Self> {
        let view = if by > 1 { Cow::Owned(view.downscaled(by)) } else { Cow::Borrowed(view) };
        let (first, size) = extent(&view)?;
        let shown = |u: u32, v: u32| view.is_training_object(u, v);
        let mut picture = RgbImage::from_pixel(size[0], size[1], EMPTY);
        let exposure = view.exposure.unwrap_or_default();
        for (top, left) in steps(size[1]).flat_map(|top| steps(size[0]).map(move |left| (top, left))) {
            let square = || {
                let [right, bottom] = [(left + BLOCK).min(size[0]), (top + BLOCK).min(size[1])];
                (top..bottom).flat_map(move |y| (left..right).map(move |x| (x, y)))
            };
            if square().any(|(x, y)| shown(first[0] + x, first[1] + y)) {
                for (x, y) in square() {
                    let color = view.image.get_pixel(first[0] + x, first[1] + y).0.map(f32::from);
                    let color = 255.0 * exposure.corrected(Vec3::from(color) / 255.0);
                    picture.put_pixel(x, y, Rgb(color.round().to_array().map(|level| level as u8)));
                }
            }
        }
        let (width, height) = view.image.dimensions();
        let is_inner = |[u, v]: [u32; 2]| {
            let is_within = u > 0 && v > 0 && u + 1 < width && v + 1 < height;
            is_within && (v - 1..=v + 1).all(|v| (u - 1..=u + 1).all(|u| shown(u, v)))
        };
        Some(Self {
            first,
            size,
            stored: encoded_jpeg(&picture, QUALITY, None).ok()?,
            spacing,
            is_inner: node_pixels(first, size, spacing).map(is_inner).collect(),
            camera: view.camera.clone(),
        })
    }

    /// z-depths of the surface at the nodes: the ray depths of pixels.
    fn depths(&self, shader: &dyn Shader) -> Vec<f16> {
        let pixels =
            node_pixels(self.first, self.size, self.spacing).zip(&self.is_inner).filter(|(_, is_inner)| **is_inner);
        let rays: Vec<Ray> = pixels.map(|([u, v], _)| self.camera.pixel_ray(u, v)).collect();
        let mut shaded = shader.shade(&rays).into_iter();
        let mut depth = |is_inner: bool| is_inner.then(|| shaded.next().flatten()).flatten().map(|shaded| shaded.depth);
        // What is farther than 16 bits can say is not kept.
        let in_16_bits = |depth: f32| Some(f16::from_f32(depth)).filter(|depth| depth.is_finite());
        self.is_inner.iter().map(|&is_inner| depth(is_inner).and_then(in_16_bits).unwrap_or(f16::ZERO)).collect()
    }

    fn photograph(self, depths: Vec<f16>) -> Option<Photograph> {
        // As it is after it was stored, so that the two are the same.
        let pixels = decoded_picture(Path::new("photograph"), &self.stored).ok()?.into_rgb8();
        let [left, top] = self.first.map(f64::from);
        let moved = DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -left, -top, 1.0]);
        let intrinsics = moved * self.camera.intrinsics;
        let (projection, offset) = (intrinsics * self.camera.rotation, intrinsics * self.camera.translation);
        let (projection, offset) = (projection.as_mat3(), offset.as_vec3());
        Photograph::new((projection, offset), (self.spacing, depths), self.stored, pixels)
    }
}

/// Where squares of a JPEG begin along an edge.
fn steps(edge: u32) -> impl Iterator<Item = u32> {
    (0..edge).step_by(BLOCK as usize)
}

/// The pixels of a photograph at whose centres the nodes of its part lie; some may be beyond its edges.
fn node_pixels(first: [u32; 2], size: [u32; 2], spacing: u32) -> impl Iterator<Item = [u32; 2]> {
    let [columns, rows] = nodes(size, spacing);
    let along = move |axis: usize, node: u32| first[axis] + node * spacing;
    (0..rows).flat_map(move |row| (0..columns).map(move |column| [along(0, column), along(1, row)]))
}
