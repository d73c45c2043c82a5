//! How a point of the surface looks in other photographs, inside a kernel.

#![allow(missing_docs)]

use cubecl::prelude::*;
use dvr_kernels::rules::{CLEARANCE, MIN_COSINE};

use super::patch::patch;
use super::photo::{Photo, photo};
use super::rays::NONE;
use super::walk::{Region, first_crossing};
use super::weights::Weights;
use crate::space::Point;

/// A pixel that is followed.
#[derive(CubeType)]
pub(super) struct Pixel {
    pub view: Photo,
    pub u: u32,
    pub v: u32,
    pub origin: Point,
    pub direction: Point,
    pub color: Point,
}

/// A loss in the making: the ray's sums, and the gradient of all by the depth.
#[derive(CubeType)]
pub(super) struct Disagreement {
    pub by_depth: RuntimeCell<f32>,
    pub color: RuntimeCell<f32>,
    pub structure: RuntimeCell<f32>,
}

/// Adds up how a point of the surface disagrees with other views.
#[cube]
pub(super) fn cross_view(
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
    let own =
        patch(views, pixels, &pixel.view, pixel.u, pixel.v, weights.structure_stride, &pixel.origin, point, inward);
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
                if size < weights.cross_view_limit {
                    found.color.store(found.color.read() + size);
                    let by_depth = weights.cross_view * residual.signs().dot(&seen.derivative);
                    found.by_depth.store(found.by_depth.read() + by_depth);
                }
                if weights.structure > 0.0f32 {
                    let likeness = own.compare(views, pixels, &pixel.view, &view);
                    if likeness.is_seen && likeness.correlation > weights.structure_limit {
                        found.structure.store(found.structure.read() + 1.0f32 - likeness.correlation);
                        found.by_depth.store(found.by_depth.read() - weights.structure * likeness.derivative);
                    }
                }
            }
        }
    }
}
