//! What a ray says of the field, a work-item per ray: the counterpart of `step::cpu::rays`.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::slope_rule::SlopeRuleArgs;
use crate::color::CHANNELS;
use crate::color::gpu::{sample, write_channel_gradient};
use crate::constants::{CLEARANCE, MIN_COSINE};
use crate::gpu::launch::NONE;
use crate::gpu::traversal::{FAR, Region, first_crossing, walk};
use crate::gpu::views::{is_object, photo};
use crate::gpu::voxel::grid;
use crate::losses::gpu::{Weights, appearance, cross_view, geometry, has_cross_view, prepare_cross_view, silhouette};
use crate::losses::term::gpu::{PixelRay, SurfaceGradient, SurfaceHit};
use crate::step::record::NUMBERS;
use crate::step::record::numbers::{GRAD_COLOR, GRAD_VALUE, INTERSECTION, LOSSES, POINT, UNION};

/// Below every value.
const LOWEST: f32 = -3.0e38;

/// What the kernel of rays needs to know besides the losses.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct RayArgs {
    pub slope_rule: SlopeRuleArgs,
    /// Nodes along an edge of the colour grid.
    pub color_nodes: u32,
    /// The first ray among those that were brought, and how many to follow.
    pub first: u32,
    pub count: u32,
    /// Other views that each is compared with.
    pub compared: u32,
}

/// Follows the rays `first..first + count` of `picks` (for each: view, pixel, then `compared` other views to compare
/// with) and writes down a record each. `most[0]` and `most[1]` are raised to the bits of the largest number that a ray
/// gradient adds to a node of the shape and of the colour.
#[cube(launch)]
pub(crate) fn follow(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    z_depths: &[f32],
    values: &[f32],
    slots: &[u32],
    occupied: &[u32],
    colors: &[f32],
    records: &mut [f32],
    most: &mut [Atomic<u32>],
    region: Region,
    args: RayArgs,
    weights: Weights,
) {
    let ray = ABSOLUTE_POS;
    if ray < args.count as usize {
        let at = ray * NUMBERS;
        #[unroll]
        for number in 0..NUMBERS {
            records[at + number] = 0.0f32;
        }
        let pick = (args.first as usize + ray) * (2 + args.compared as usize);
        // Without the loss there are no depth maps.
        let has_depth = weights.depth.weight > 0.0f32;
        let pixel = pixel_ray(views, pixels, z_depths, picks[pick], picks[pick + 1], has_depth);
        let hit = first_crossing(values, occupied, &region, &pixel.origin, &pixel.direction, 0.0f32, f32::new(FAR));
        let (shows, hits) = (pixel.object, hit >= 0.0f32);
        if shows || hits {
            records[at + UNION] = 1.0f32;
        }
        if shows && hits {
            records[at + INTERSECTION] = 1.0f32;
            surface_gradient(
                picks,
                views,
                pixels,
                values,
                occupied,
                colors,
                records,
                &pixel,
                &region,
                &args,
                &weights,
                hit,
                pick + 2,
                at,
            );
        }
        if shows != hits {
            let (from, sign) = (select(hits, hit, 0.0f32), select(hits, 1.0f32, -1.0f32));
            silhouette_gradient(values, slots, records, &pixel, &region, &weights, from, sign, at);
        }
        most[0].fetch_max(u32::reinterpret(records[at + GRAD_VALUE].abs()));
        let mut grad_color = 0.0f32;
        #[unroll]
        for c in 0..CHANNELS {
            grad_color = grad_color.max(records[at + GRAD_COLOR + c].abs());
        }
        most[1].fetch_max(u32::reinterpret(grad_color));
    }
}

/// A pixel and its ray, by the view and the index in its picture.
#[cube]
fn pixel_ray(views: &[u32], pixels: &[u32], z_depths: &[f32], view: u32, index: u32, has_depth: bool) -> PixelRay {
    let view = photo(views, view);
    let (u, v) = (index % view.width, index / view.width);
    let place = view.index(u, v);
    let shown = pixels[place];
    let (origin, direction) = (view.center(views), view.direction(views, u, v));
    let mut z_depth = f32::new(FAR);
    if has_depth {
        z_depth = z_depths[place];
    }
    let color = view.color(views, shown);
    PixelRay { view, u, v, origin, direction, color, object: is_object(shown), z_depth }
}

/// An object pixel whose ray hits: colour, the same point in other views, depth.
#[cube]
fn surface_gradient(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    values: &[f32],
    occupied: &[u32],
    colors: &[f32],
    records: &mut [f32],
    pixel: &PixelRay,
    region: &Region,
    args: &RayArgs,
    weights: &Weights,
    depth: f32,
    others: usize,
    at: usize,
) {
    let shape = region.grid();
    let point = pixel.origin.along(&pixel.direction, depth);
    let gradient = shape.slope(values, &point).gradient;
    let steepness = gradient.length().max(1e-6f32);
    let shown = sample(colors, &grid(args.color_nodes, region.half_extent), &point, &pixel.direction);
    let hit = SurfaceHit {
        depth,
        point: point.copied(),
        inward: gradient.over(steepness),
        color: shown.color.copied(),
        color_derivative: shown.derivative.copied(),
    };

    let found = SurfaceGradient::zero();
    appearance(weights, pixel, &hit, &found, records, at + LOSSES);
    if has_cross_view(weights) {
        let grad_depth = comparisons(
            picks, views, pixels, values, occupied, records, pixel, &hit, region, args, weights, others, at,
        );
        found.add_depth(grad_depth / f32::cast_from(max(args.compared, 1u32)));
    }
    geometry(weights, pixel, &hit, &found, records, at + LOSSES);

    // The implicit function theorem: how the depth of the hit depends on the value there.
    let scale = steepness * pixel.direction.length();
    let inverse_slope = args.slope_rule.inverse_slope(gradient.dot(&pixel.direction), scale);
    records[at + POINT] = point.x;
    records[at + POINT + 1] = point.y;
    records[at + POINT + 2] = point.z;
    records[at + GRAD_VALUE] = -found.by_depth() * inverse_slope;
    write_channel_gradient(&found.by_color(), &pixel.direction, records, at + GRAD_COLOR);
}

/// Compares a hit with the other views that face its surface and see it; returns the gradient by the depth.
#[cube]
fn comparisons(
    picks: &[u32],
    views: &[u32],
    pixels: &[u32],
    values: &[f32],
    occupied: &[u32],
    records: &mut [f32],
    pixel: &PixelRay,
    hit: &SurfaceHit,
    region: &Region,
    args: &RayArgs,
    weights: &Weights,
    others: usize,
    at: usize,
) -> f32 {
    let grad_depth = RuntimeCell::<f32>::new(0.0f32);
    let prepared = prepare_cross_view(weights, views, pixels, pixel, hit);
    for k in 0..args.compared {
        let other = picks[others + k as usize];
        if other != NONE {
            let view = photo(views, other);
            let to_view = view.center(views).minus(&hit.point);
            let distance = to_view.length();
            let seen = view.reproject(views, pixels, &hit.point, &pixel.direction);
            let faces = -hit.inward.dot(&to_view) >= MIN_COSINE * distance;
            let mut shows = seen.is_object && faces;
            if shows {
                let clearance = CLEARANCE * region.grid().spacing / distance;
                shows = first_crossing(values, occupied, region, &hit.point, &to_view, clearance, 1.0f32) < 0.0f32;
            }
            if shows {
                cross_view(weights, &prepared, views, pixels, pixel, &view, &seen, &grad_depth, records, at + LOSSES);
            }
        }
    }
    grad_depth.read()
}

/// A ray that hits though its pixel shows background (`sign` 1), or misses though it shows the object (-1): the point
/// of the largest value beyond `from` is pushed out, or in.
#[cube]
fn silhouette_gradient(
    values: &[f32],
    slots: &[u32],
    records: &mut [f32],
    pixel: &PixelRay,
    region: &Region,
    weights: &Weights,
    from: f32,
    sign: f32,
    at: usize,
) {
    let shape = region.grid();
    let mut largest = f32::new(LOWEST);
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
    if largest > LOWEST {
        let point = pixel.origin.along(&pixel.direction, depth);
        records[at + POINT] = point.x;
        records[at + POINT + 1] = point.y;
        records[at + POINT + 2] = point.z;
        records[at + GRAD_VALUE] = silhouette(weights, largest, sign, records, at + LOSSES);
    }
}
