//! Patches of surface compared between photographs by their structure, inside a kernel.

#![allow(missing_docs)]

use crate::constants::{MAX_STRETCH, PATCH_NOISE, PATCH_SIDE};
use cubecl::prelude::*;

use super::photo::{Photo, color, is_object};
use super::space::Point;

/// Samples of a patch: along its side, and all.
const SIDE: u32 = PATCH_SIDE as u32;
const SAMPLES: usize = PATCH_SIDE * PATCH_SIDE;

/// Brightnesses around a pixel, on the plane that its ray meets.
#[derive(CubeType)]
pub(crate) struct Patch {
    /// Whether the object and the plane can be seen in all samples.
    pub is_whole: bool,
    u: u32,
    v: u32,
    stride: u32,
    origin: Point,
    normal: Point,
    /// The plane's distance from the camera along its normal, and how fast the normal is approached on the middle ray.
    height: f32,
    slope: f32,
    /// Less their mean.
    brightness: Array<f32>,
    variance: f32,
}

/// How alike two patches are, and how that changes as the surface moves along the ray.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Likeness {
    /// Whether the other view shows all of the patch.
    pub is_seen: bool,
    pub correlation: f32,
    pub derivative: f32,
}

/// The patch around a pixel whose ray meets the surface at `point`, on the plane with this normal.
#[cube]
pub(crate) fn patch(
    views: &[u32],
    pixels: &[u32],
    own: &Photo,
    u: u32,
    v: u32,
    stride: u32,
    origin: &Point,
    point: &Point,
    normal: &Point,
) -> Patch {
    let height = normal.dot(&point.minus(origin));
    let slope = normal.dot(&own.direction(views, u, v));
    let depth = height / slope;
    let mut brightness = Array::<f32>::new(SAMPLES);
    let mut is_whole = true;
    for i in 0..SAMPLES {
        let column = u + (i as u32 % SIDE) * stride;
        let row = v + (i as u32 / SIDE) * stride;
        let within = column >= stride && row >= stride && column - stride < own.width && row - stride < own.height;
        // Out of the frame, the pixel itself stands in.
        let x = select(within, column - stride, u);
        let y = select(within, row - stride, v);
        let pixel = pixels[own.index(x, y)];
        let shown = color(pixel);
        brightness[i] = shown.sum() / 3.0f32;
        let stretch = height / normal.dot(&own.direction(views, x, y)) / depth;
        let is_near = stretch < MAX_STRETCH && stretch * MAX_STRETCH > 1.0f32;
        is_whole = is_whole && within && is_object(pixel) && is_near;
    }
    let variance = center(&mut brightness);
    Patch {
        is_whole,
        u,
        v,
        stride,
        origin: origin.copied(),
        normal: normal.copied(),
        height,
        slope,
        brightness,
        variance,
    }
}

#[cube]
impl Patch {
    /// Compares with what another view shows at the same points.
    pub fn compare(&self, views: &[u32], pixels: &[u32], own: &Photo, other: &Photo) -> Likeness {
        let mut seen = Array::<f32>::new(SAMPLES);
        let mut moves = Array::<f32>::new(SAMPLES);
        let mut is_seen = self.is_whole;
        if is_seen {
            for i in 0..SAMPLES {
                let column = self.u + (i as u32 % SIDE) * self.stride - self.stride;
                let row = self.v + (i as u32 / SIDE) * self.stride - self.stride;
                let direction = own.direction(views, column, row);
                let approach = self.normal.dot(&direction);
                let point = self.origin.along(&direction, self.height / approach);
                let at = other.reproject(views, pixels, &point, &direction.times(self.slope / approach));
                seen[i] = at.color.sum() / 3.0f32;
                moves[i] = at.derivative.sum() / 3.0f32;
                is_seen = is_seen && at.is_object;
            }
        }
        let variance = center(&mut seen);
        let mut likeness = 0.0f32;
        let mut own_moves = 0.0f32;
        let mut seen_moves = 0.0f32;
        for i in 0..SAMPLES {
            likeness += self.brightness[i] * seen[i];
            own_moves += self.brightness[i] * moves[i];
            seen_moves += seen[i] * moves[i];
        }
        let samples = comptime!(SAMPLES as f32);
        let scale = ((self.variance + PATCH_NOISE) * (variance + PATCH_NOISE)).sqrt();
        let correlation = likeness / samples / scale;
        let derivative = own_moves / samples / scale - correlation * (seen_moves / samples) / (variance + PATCH_NOISE);
        Likeness { is_seen, correlation, derivative }
    }
}

/// Subtracts the mean; returns the variance.
#[cube]
fn center(values: &mut Array<f32>) -> f32 {
    let samples = comptime!(SAMPLES as f32);
    let mut sum = 0.0f32;
    for i in 0..SAMPLES {
        sum += values[i];
    }
    let mean = sum / samples;
    let mut squares = 0.0f32;
    for i in 0..SAMPLES {
        let value = values[i] - mean;
        values[i] = value;
        squares += value * value;
    }
    squares / samples
}
