//! How far views agree on the colours of the surface, as a kernel: the counterpart of `crate::color_trust`.

#![allow(missing_docs)]

use cubecl::prelude::*;

use crate::color_trust::AROUND;
use crate::constants::{CLEARANCE, MIN_COSINE};
use crate::gpu::launch::NONE;
use crate::gpu::traversal::{FAR, Region, first_crossing};
use crate::gpu::views::{Photo, is_object, photo};
use crate::gpu::voxel::Point;

/// What is found where there is nothing to compare.
pub(crate) const NOTHING: f32 = -1.0;

/// The least and the greatest colour around a pixel, by channel, and how many of the pixels there show the object.
#[derive(CubeType, Clone, Copy)]
struct ColorRange {
    low: Point,
    high: Point,
    count: u32,
}

#[cube]
fn color_range(photo: &Photo, views: &[u32], pixels: &[u32], u: u32, v: u32) -> ColorRange {
    let mut low_x = f32::new(FAR);
    let mut low_y = f32::new(FAR);
    let mut low_z = f32::new(FAR);
    let mut high_x = -f32::new(FAR);
    let mut high_y = -f32::new(FAR);
    let mut high_z = -f32::new(FAR);
    let mut count = 0u32;
    for dy in 0..comptime!(2 * AROUND + 1) {
        for dx in 0..comptime!(2 * AROUND + 1) {
            let (x, y) = (u + dx, v + dy);
            // One more than they are, so that nothing is negative.
            if x >= AROUND && y >= AROUND && x - AROUND < photo.width && y - AROUND < photo.height {
                let shown = pixels[photo.index(x - AROUND, y - AROUND)];
                if is_object(shown) {
                    let color = photo.color(views, shown);
                    low_x = low_x.min(color.x);
                    low_y = low_y.min(color.y);
                    low_z = low_z.min(color.z);
                    high_x = high_x.max(color.x);
                    high_y = high_y.max(color.y);
                    high_z = high_z.max(color.z);
                    count += 1u32;
                }
            }
        }
    }
    ColorRange { low: Point::new(low_x, low_y, low_z), high: Point::new(high_x, high_y, high_z), count }
}

/// How far two ranges are apart in a channel.
#[cube]
fn gap(low: f32, high: f32, low_other: f32, high_other: f32) -> f32 {
    (low - high_other).max(low_other - high).max(0.0f32)
}

/// How far other views differ in colour from `count` pixels at their hits: the mean, summed over the channels;
/// [`NOTHING`] where no view sees a hit. `picks` has for each its view, its pixel, then `compared` other views.
#[cube(launch)]
pub(crate) fn differences(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    values: &[f32],
    occupied: &[u32],
    found: &mut [f32],
    region: Region,
    compared: u32,
    count: u32,
) {
    let ray = ABSOLUTE_POS;
    if ray < count as usize {
        let pick = ray * (2 + compared as usize);
        let own = photo(views, picks[pick]);
        let (u, v) = (picks[pick + 1] % own.width, picks[pick + 1] / own.width);
        let mut difference = f32::new(NOTHING);
        // Pixels at the outline are part background.
        let within = u >= 1u32 && v >= 1u32 && u + 1u32 < own.width && v + 1u32 < own.height;
        let range = color_range(&own, views, pixels, u, v);
        if within && range.count == comptime!((2 * AROUND + 1) * (2 * AROUND + 1)) {
            let (origin, direction) = (own.center(views), own.direction(views, u, v));
            let hit = first_crossing(values, occupied, &region, &origin, &direction, 0.0f32, f32::new(FAR));
            if hit >= 0.0f32 {
                let at = origin.along(&direction, hit);
                let gradient = region.grid().slope(values, &at).gradient;
                let inward = gradient.over(gradient.length().max(1e-6f32));
                let mut sum = 0.0f32;
                let mut seen = 0.0f32;
                for k in 0..compared {
                    let other = picks[pick + 2 + k as usize];
                    if other != NONE {
                        let view = photo(views, other);
                        let q = view.projected(views, &at);
                        let (x, y) = (q.x / q.z, q.y / q.z);
                        let is_in_frame = q.z > 0.0f32
                            && x >= 0.0f32
                            && y >= 0.0f32
                            && x < f32::cast_from(view.width)
                            && y < f32::cast_from(view.height);
                        let to_view = view.center(views).minus(&at);
                        let distance = to_view.length();
                        let faces = -inward.dot(&to_view) >= MIN_COSINE * distance;
                        let mut shows = false;
                        if is_in_frame && faces {
                            shows = is_object(pixels[view.index(u32::cast_from(x), u32::cast_from(y))]);
                        }
                        if shows {
                            let clearance = CLEARANCE * region.grid().spacing / distance;
                            shows =
                                first_crossing(values, occupied, &region, &at, &to_view, clearance, 1.0f32) < 0.0f32;
                        }
                        if shows {
                            let around = color_range(&view, views, pixels, u32::cast_from(x), u32::cast_from(y));
                            sum += gap(range.low.x, range.high.x, around.low.x, around.high.x)
                                + gap(range.low.y, range.high.y, around.low.y, around.high.y)
                                + gap(range.low.z, range.high.z, around.low.z, around.high.z);
                            seen += 1.0f32;
                        }
                    }
                }
                if seen > 0.0f32 {
                    difference = sum / seen;
                }
            }
        }
        found[ray] = difference;
    }
}
