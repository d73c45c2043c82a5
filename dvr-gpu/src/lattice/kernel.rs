//! Interpolation between the nodes of a lattice and its transposes, a point at a time.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::place::place_of;

/// `out [n, C]`, or with `jet` `out [n, 2 C]`: values at points, then derivatives along directions.
#[cube(launch)]
pub(super) fn interpolate(
    values: &[f32],
    points: &[f32],
    directions: &[f32],
    out: &mut [f32],
    count: u32,
    nodes: u32,
    half_extent: f32,
    #[comptime] channels: usize,
    #[comptime] jet: bool,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let place = place_of(points, i, nodes, half_extent);
        let columns = comptime!(if jet { 2 * channels } else { channels });
        #[unroll]
        for c in 0..channels {
            let mut value = 0.0f32;
            let mut derivative = 0.0f32;
            #[unroll]
            for corner in 0..8usize {
                let number = values[place.corner(corner, nodes) * channels + c];
                value += place.weight(corner) * number;
                if comptime!(jet) {
                    let mut slope = 0.0f32;
                    #[unroll]
                    for axis in 0..3usize {
                        slope += place.slope(corner, axis) * directions[i * 3 + axis];
                    }
                    derivative += slope * number;
                }
            }
            out[i * columns + c] = value;
            if comptime!(jet) {
                out[i * columns + channels + c] = derivative;
            }
        }
    }
}

/// The most that a point can add to a node, `bounds [n]`, given the gradient by its values (and derivatives), `by`.
#[cube(launch)]
pub(super) fn bound(
    points: &[f32],
    directions: &[f32],
    by: &[f32],
    bounds: &mut [f32],
    count: u32,
    nodes: u32,
    half_extent: f32,
    #[comptime] channels: usize,
    #[comptime] jet: bool,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let columns = comptime!(if jet { 2 * channels } else { channels });
        let mut most = 0.0f32;
        let mut steepest = 0.0f32;
        #[unroll]
        for c in 0..channels {
            most = most.max(by[i * columns + c].abs());
            if comptime!(jet) {
                steepest = steepest.max(by[i * columns + channels + c].abs());
            }
        }
        if comptime!(jet) {
            let place = place_of(points, i, nodes, half_extent);
            let mut length = 0.0f32;
            #[unroll]
            for axis in 0..3usize {
                length += (directions[i * 3 + axis] * place.scale.axis(axis)).abs();
            }
            most += steepest * length;
        }
        bounds[i] = most;
    }
}

/// The largest sum of a node, in units of its last bit: a power of two below the largest whole number.
const FULL: f32 = 1_073_741_824.0;

/// Adds what each point says of its cell's corners to `sums [nodes, C]`, in whole numbers of `most * count / 2^30`:
/// they add up to the same in whatever order.
#[cube(launch)]
pub(super) fn scatter(
    points: &[f32],
    directions: &[f32],
    by: &[f32],
    most: &[f32],
    sums: &mut [Atomic<i32>],
    count: u32,
    nodes: u32,
    half_extent: f32,
    #[comptime] channels: usize,
    #[comptime] jet: bool,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let place = place_of(points, i, nodes, half_extent);
        let columns = comptime!(if jet { 2 * channels } else { channels });
        let scale = f32::new(FULL) / (most[0] * f32::cast_from(count));
        #[unroll]
        for corner in 0..8usize {
            let node = place.corner(corner, nodes);
            let weight = place.weight(corner);
            let mut slope = 0.0f32;
            if comptime!(jet) {
                #[unroll]
                for axis in 0..3usize {
                    slope += place.slope(corner, axis) * directions[i * 3 + axis];
                }
            }
            #[unroll]
            for c in 0..channels {
                let mut part = weight * by[i * columns + c];
                if comptime!(jet) {
                    part += slope * by[i * columns + channels + c];
                }
                sums[node * channels + c].fetch_add(i32::cast_from((part * scale).round()));
            }
        }
    }
}

/// What [`scatter`] added up, as numbers.
#[cube(launch)]
pub(super) fn gathered(sums: &[i32], most: &[f32], out: &mut [f32], length: u32, count: u32) {
    let i = ABSOLUTE_POS;
    if i < length as usize {
        out[i] = f32::cast_from(sums[i]) * (most[0] * f32::cast_from(count) / f32::new(FULL));
    }
}

/// The gradient by points, `out [n, 3]`, or with `jet` by points and directions, `out [n, 6]`, given that by values
/// (and derivatives).
#[cube(launch)]
pub(super) fn by_points(
    values: &[f32],
    points: &[f32],
    directions: &[f32],
    by: &[f32],
    out: &mut [f32],
    count: u32,
    nodes: u32,
    half_extent: f32,
    #[comptime] channels: usize,
    #[comptime] jet: bool,
) {
    let i = ABSOLUTE_POS;
    if i < count as usize {
        let place = place_of(points, i, nodes, half_extent);
        let columns = comptime!(if jet { 2 * channels } else { channels });
        let rows = comptime!(if jet { 6 } else { 3 });
        #[unroll]
        for axis in 0..3usize {
            let mut by_point = 0.0f32;
            let mut by_direction = 0.0f32;
            #[unroll]
            for corner in 0..8usize {
                let at = place.corner(corner, nodes) * channels;
                let mut value = 0.0f32;
                let mut derivative = 0.0f32;
                #[unroll]
                for c in 0..channels {
                    value += values[at + c] * by[i * columns + c];
                    if comptime!(jet) {
                        derivative += values[at + c] * by[i * columns + channels + c];
                    }
                }
                let slope = place.slope(corner, axis);
                by_point += slope * value;
                if comptime!(jet) {
                    by_direction += slope * derivative;
                    let (second, third) = comptime!(((axis + 1) % 3, (axis + 2) % 3));
                    by_point += place.second(corner, axis, second) * directions[i * 3 + second] * derivative;
                    by_point += place.second(corner, axis, third) * directions[i * 3 + third] * derivative;
                }
            }
            out[i * rows + axis] = by_point;
            if comptime!(jet) {
                out[i * rows + 3 + axis] = by_direction;
            }
        }
    }
}
