//! How a point of the surface looks in other photographs, inside a kernel.

#![allow(missing_docs)]

use crate::constants::{CLEARANCE, MIN_COSINE};
use cubecl::prelude::*;

use super::patch::patch;
use super::photo::{Photo, photo};
use super::rays::NONE;
use super::space::Point;
use super::walk::{Region, first_crossing};
use super::weights::Weights;

/// A pixel that is followed.
#[derive(CubeType)]
pub(crate) struct Pixel {
    pub view: Photo,
    pub u: u32,
    pub v: u32,
    pub origin: Point,
    pub direction: Point,
    pub color: Point,
}

/// A loss in the making: the ray's sums, and the gradient of all by the depth.
#[derive(CubeType)]
pub(crate) struct Disagreement {
    pub grad_depth: RuntimeCell<f32>,
    pub color: RuntimeCell<f32>,
    pub patch_ncc: RuntimeCell<f32>,
}

/// Adds up how a point of the surface disagrees with other views.
#[cube]
pub(crate) fn photo_consistency(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    values: &[f32],
    marks: &[u32],
    pixel: &Pixel,
    region: &Region,
    weights: &Weights,
    point: &Point,
    inward: &Point,
    others: usize,
    compared: u32,
    found: &Disagreement,
) {
    let own = patch(views, pixels, &pixel.view, pixel.u, pixel.v, weights.patch_stride, &pixel.origin, point, inward);
    for k in 0..compared {
        let other = picks[others + k as usize];
        if other != NONE {
            let view = photo(views, other);
            let to_view = view.center(views).minus(point);
            let distance = to_view.length();
            let seen = view.reproject(views, pixels, point, &pixel.direction);
            let faces = -inward.dot(&to_view) >= MIN_COSINE * distance;
            let mut shows = seen.is_object && faces;
            if shows {
                let clearance = CLEARANCE * region.grid().spacing / distance;
                shows = first_crossing(values, marks, region, point, &to_view, clearance, 1.0f32) < 0.0f32;
            }
            if shows {
                let residual = seen.color.minus(&pixel.color);
                let size = residual.size();
                if size < weights.photo_consistency_limit {
                    found.color.store(found.color.read() + size);
                    let grad_depth = weights.photo_consistency * residual.signs().dot(&seen.derivative);
                    found.grad_depth.store(found.grad_depth.read() + grad_depth);
                }
                if weights.patch_ncc > 0.0f32 {
                    let likeness = own.compare(views, pixels, &pixel.view, &view);
                    if likeness.is_seen && likeness.correlation > weights.patch_ncc_min {
                        found.patch_ncc.store(found.patch_ncc.read() + 1.0f32 - likeness.correlation);
                        found.grad_depth.store(found.grad_depth.read() - weights.patch_ncc * likeness.derivative);
                    }
                }
            }
        }
    }
}
