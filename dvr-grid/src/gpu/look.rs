//! What rays see of a field on grids, and what it is at points, inside a kernel: the
//! counterpart of `GridField`.

#![allow(missing_docs)]

use cubecl::prelude::*;

use crate::color::gpu::sample;

use super::traversal::{FAR, Region, first_crossing};
use super::voxel::{Grid, Point, grid};

/// Numbers of a ray: origin and direction.
pub const RAY_COLUMNS: usize = 6;

/// Numbers of what a ray sees: ray depth, below zero where it sees nothing, colour and outward normal.
pub const SHADED_COLUMNS: usize = 7;

/// Writes a point's coordinates side by side.
#[cube]
fn write(point: &Point, numbers: &mut [f32], at: usize) {
    numbers[at] = point.x;
    numbers[at + 1] = point.y;
    numbers[at + 2] = point.z;
}

/// sRGB colour at a point seen along `viewing`, in `[0, 1]`.
#[cube]
fn color_at(colors: &[f32], grid: &Grid, point: &Point, viewing: &Point) -> Point {
    let color = sample(colors, grid, point, viewing).color;
    Point::new(color.x.clamp(0.0f32, 1.0f32), color.y.clamp(0.0f32, 1.0f32), color.z.clamp(0.0f32, 1.0f32))
}

/// What rays see, a work-item a ray.
#[cube(launch)]
pub(crate) fn shade(
    rays: &[f32],
    values: &[f32],
    marks: &[u32],
    colors: &[f32],
    shaded: &mut [f32],
    region: Region,
    color_nodes: u32,
    color_half_extent: f32,
    count: u32,
) {
    let ray = ABSOLUTE_POS;
    if ray < count as usize {
        let origin = Point::read(rays, ray * RAY_COLUMNS);
        let direction = Point::read(rays, ray * RAY_COLUMNS + 3);
        let at = ray * SHADED_COLUMNS;
        let depth = first_crossing(values, marks, &region, &origin, &direction, 0.0f32, f32::new(FAR));
        shaded[at] = depth;
        if depth >= 0.0f32 {
            let place = origin.along(&direction, depth);
            write(&color_at(colors, &grid(color_nodes, color_half_extent), &place, &direction), shaded, at + 1);
            let gradient = region.grid().slope(values, &place).gradient;
            let length = gradient.length();
            // Where the field is flat there is no normal.
            write(&gradient.times(select(length > 0.0f32, -1.0f32 / length, 0.0f32)), shaded, at + 4);
        }
    }
}

/// Interpolated values at points, one number each, or with `slopes` their gradients, three each.
#[cube(launch)]
pub(crate) fn values_at(
    points: &[f32],
    values: &[f32],
    found: &mut [f32],
    nodes: u32,
    half_extent: f32,
    count: u32,
    #[comptime] slopes: bool,
) {
    let index = ABSOLUTE_POS;
    if index < count as usize {
        let slope = grid(nodes, half_extent).slope(values, &Point::read(points, index * 3));
        if comptime!(slopes) {
            write(&slope.gradient, found, index * 3);
        } else {
            found[index] = slope.value;
        }
    }
}

/// Colours at points (place, and the direction that it is seen along), three numbers each.
#[cube(launch)]
pub(crate) fn colors_at(points: &[f32], colors: &[f32], found: &mut [f32], nodes: u32, half_extent: f32, count: u32) {
    let index = ABSOLUTE_POS;
    if index < count as usize {
        let place = Point::read(points, index * RAY_COLUMNS);
        let viewing = Point::read(points, index * RAY_COLUMNS + 3);
        write(&color_at(colors, &grid(nodes, half_extent), &place, &viewing), found, index * 3);
    }
}
