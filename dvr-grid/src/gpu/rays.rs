//! What a ray teaches, a work-item a ray: the twin of the fast method's rays on the processor.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::photo::{color, is_object, photo};
use super::photo_consistency::{Disagreement, Pixel, photo_consistency};
use super::space::{Point, grid};
use super::walk::{FAR, Region, first_crossing, walk};
use super::weights::Weights;

/// Numbers of a ray_gradient: point, gradient by the shape's value, by the colour; then the ray's losses by colour,
/// cross-view colour, structure, depth and mask, and whether it hits and shows the object, and does either.
pub const RAY_GRADIENT_COLUMNS: usize = 14;

/// A view of none, a node that carries no parameters.
pub(crate) const NONE: u32 = u32::MAX;

/// Below every value.
const NOTHING: f32 = -3.0e38;

/// Follows the rays `first..first + count` of `picks` (for each: view, pixel, then `compared` other views to compare
/// with) and writes down a ray_gradient each; `most[0]` and `most[1]` are raised to the bits of the largest number that a
/// ray_gradient adds to a node of the shape and of the colour.
#[cube(launch)]
pub(crate) fn follow(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    z_depths: &[f32],
    values: &[f32],
    slots: &[u32],
    marks: &[u32],
    colors: &[f32],
    ray_gradients: &mut [f32],
    most: &mut [Atomic<u32>],
    region: Region,
    color_nodes: u32,
    weights: Weights,
    first: u32,
    count: u32,
    compared: u32,
) {
    let ray = ABSOLUTE_POS;
    if ray < count as usize {
        let at = ray * RAY_GRADIENT_COLUMNS;
        #[unroll]
        for column in 0..RAY_GRADIENT_COLUMNS {
            ray_gradients[at + column] = 0.0f32;
        }
        let pick = (first as usize + ray) * (2 + compared as usize);
        let view = photo(views, picks[pick]);
        let index = picks[pick + 1];
        let (u, v) = (index % view.width, index / view.width);
        let place = view.index(u, v);
        let shown = pixels[place];
        let (origin, direction) = (view.center(views), view.direction(views, u, v));
        let pixel = Pixel { view, u, v, origin: origin.copied(), direction: direction.copied(), color: color(shown) };
        let hit = first_crossing(values, marks, &region, &origin, &direction, 0.0f32, f32::new(FAR));
        let (shows, hits) = (is_object(shown), hit >= 0.0f32);
        if shows || hits {
            ray_gradients[at + 13] = 1.0f32;
        }
        if shows && hits {
            ray_gradients[at + 12] = 1.0f32;
            let z_depth = if weights.depth > 0.0f32 { z_depths[place] } else { f32::new(FAR) };
            surface_gradient(
                picks,
                views,
                pixels,
                values,
                marks,
                colors,
                ray_gradients,
                &pixel,
                &region,
                color_nodes,
                &weights,
                hit,
                z_depth,
                pick + 2,
                compared,
                at,
            );
        }
        if shows != hits {
            let (from, sign) = (select(hits, hit, 0.0f32), select(hits, 1.0f32, -1.0f32));
            mask_gradient(values, slots, ray_gradients, &pixel, &region, &weights, from, sign, at);
        }
        let grad_color = ray_gradients[at + 4].abs().max(ray_gradients[at + 5].abs()).max(ray_gradients[at + 6].abs());
        most[0].fetch_max(u32::reinterpret(ray_gradients[at + 3].abs()));
        most[1].fetch_max(u32::reinterpret(grad_color));
    }
}

/// An object pixel whose ray hits: colour, the same point in other views, depth.
#[cube]
fn surface_gradient(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    values: &[f32],
    marks: &[u32],
    colors: &[f32],
    ray_gradients: &mut [f32],
    pixel: &Pixel,
    region: &Region,
    color_nodes: u32,
    weights: &Weights,
    depth: f32,
    z_depth: f32,
    others: usize,
    compared: u32,
    at: usize,
) {
    let shape = region.grid();
    let point = pixel.origin.along(&pixel.direction, depth);
    let gradient = shape.slope(values, &point).gradient;
    let steepness = gradient.length().max(1e-6f32);

    let color_grid = grid(color_nodes, region.half_extent);
    let cell = color_grid.locate(&point);
    let in_cells = pixel.direction.over(color_grid.spacing);
    let mut red = 0.0f32;
    let mut green = 0.0f32;
    let mut blue = 0.0f32;
    let mut grad_depth = 0.0f32;
    let mut along_red = 0.0f32;
    let mut along_green = 0.0f32;
    let mut along_blue = 0.0f32;
    #[unroll]
    for corner in 0..8usize {
        let node = color_grid.corner(cell.node, corner) * 3;
        let (weight, slope) = (cell.weight(corner), cell.gradient_weight(corner, &in_cells));
        red += weight * colors[node];
        green += weight * colors[node + 1];
        blue += weight * colors[node + 2];
        along_red += slope * colors[node];
        along_green += slope * colors[node + 1];
        along_blue += slope * colors[node + 2];
    }
    let residual = Point::new(red, green, blue).minus(&pixel.color);
    let sign = residual.signs();
    grad_depth += weights.color * sign.dot(&Point::new(along_red, along_green, along_blue));
    ray_gradients[at + 7] = residual.size();

    if weights.photo_consistency > 0.0f32 || weights.patch_ncc > 0.0f32 {
        let found = Disagreement {
            grad_depth: RuntimeCell::new(0.0f32),
            color: RuntimeCell::new(0.0f32),
            patch_ncc: RuntimeCell::new(0.0f32),
        };
        let inward = gradient.over(steepness);
        photo_consistency(
            picks, views, pixels, values, marks, pixel, region, weights, &point, &inward, others, compared, &found,
        );
        grad_depth += found.grad_depth.read() / weights.compared;
        ray_gradients[at + 8] = found.color.read();
        ray_gradients[at + 9] = found.patch_ncc.read();
    }
    // Beyond everything where nothing was measured.
    if weights.depth > 0.0f32 && z_depth.abs() < f32::new(FAR) {
        // Ray depth is z-depth; in space a step of it is as long as the direction.
        let error = depth - z_depth;
        let length = pixel.direction.length();
        grad_depth += weights.depth * length * select(error < 0.0f32, -1.0f32, 1.0f32);
        ray_gradients[at + 10] = error.abs() * length;
    }

    // The implicit function theorem, scale-free at grazing rays.
    let scale = (steepness * pixel.direction.length()).max(1e-20f32);
    let cosine = gradient.dot(&pixel.direction) / scale;
    let inverse_slope = cosine / (cosine * cosine + weights.grazing * weights.grazing) / scale;
    let grad_color = weights.color + weights.texture;
    ray_gradients[at] = point.x;
    ray_gradients[at + 1] = point.y;
    ray_gradients[at + 2] = point.z;
    ray_gradients[at + 3] = -grad_depth * inverse_slope;
    ray_gradients[at + 4] = grad_color * sign.x;
    ray_gradients[at + 5] = grad_color * sign.y;
    ray_gradients[at + 6] = grad_color * sign.z;
}

/// A ray that hits though its pixel shows background (`sign` 1), or misses though it shows the object (-1): the point
/// of the largest value beyond `from` is pushed out, or in.
#[cube]
fn mask_gradient(
    values: &[f32],
    slots: &[u32],
    ray_gradients: &mut [f32],
    pixel: &Pixel,
    region: &Region,
    weights: &Weights,
    from: f32,
    sign: f32,
    at: usize,
) {
    let shape = region.grid();
    let mut largest = f32::new(NOTHING);
    let mut depth = 0.0f32;
    let walk = walk(region, &pixel.origin, &pixel.direction, from, f32::new(FAR));
    while walk.is_going() {
        if slots[walk.node(region.nodes) as usize] != NONE {
            let middle = 0.5f32 * (walk.enter() + walk.leave());
            let value = shape.slope(values, &pixel.origin.along(&pixel.direction, middle)).value;
            if value > largest {
                largest = value;
                depth = middle;
            }
        }
        walk.advance(region);
    }
    if largest > NOTHING {
        let point = pixel.origin.along(&pixel.direction, depth);
        let logit = sign * weights.sharpness * largest;
        // softplus(logit) and its derivative.
        ray_gradients[at + 11] = logit.max(0.0f32) + (1.0f32 + (-logit.abs()).exp()).ln();
        ray_gradients[at] = point.x;
        ray_gradients[at + 1] = point.y;
        ray_gradients[at + 2] = point.z;
        ray_gradients[at + 3] = weights.mask * sign * weights.sharpness / (1.0f32 + (-logit).exp());
    }
}
