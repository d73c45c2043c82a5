//! Where the rays of pictures pass through the visual hull, inside a kernel: the counterpart of [`super::super::hull`].

#![allow(missing_docs)]

use cubecl::prelude::*;

use crate::gpu::traversal::{FAR, Region, first_crossing};
use crate::gpu::views::photo;
use crate::gpu::voxel::Point;

/// Depths of a pixel: where its ray enters the hull, and where it leaves it.
pub(super) const DEPTHS: usize = 2;

/// The z-depths at which the rays of a picture's `count` pixels enter and leave the hull; the first larger where they miss.
#[cube(launch)]
pub(super) fn ranges(
    views: &[u32],
    grey: &[f32],
    values: &[f32],
    marks: &[u32],
    found: &mut [f32],
    region: Region,
    view: u32,
    count: u32,
) {
    let pixel = ABSOLUTE_POS as u32;
    if pixel < count {
        let photo = photo(views, view);
        let (u, v) = (pixel % photo.width, pixel / photo.width);
        let at = photo.index(u, v);
        let mut near = 1.0f32;
        let mut far = 0.0f32;
        if grey[at] >= 0.0f32 {
            let (origin, direction) = (photo.center(views), photo.direction(views, u, v));
            let enters = first_crossing(values, marks, &region, &origin, &direction, 0.0f32, f32::new(FAR));
            if enters >= 0.0f32 {
                let beyond = 2.0f32 * origin.length() + 2.0f32;
                let (from, back) =
                    (origin.along(&direction, beyond), Point::new(0.0f32, 0.0f32, 0.0f32).minus(&direction));
                let leaves = first_crossing(values, marks, &region, &from, &back, 0.0f32, f32::new(FAR));
                if leaves >= 0.0f32 {
                    near = enters;
                    far = (beyond - leaves).max(enters);
                }
            }
        }
        found[at * comptime!(DEPTHS)] = near;
        found[at * comptime!(DEPTHS) + 1] = far;
    }
}
