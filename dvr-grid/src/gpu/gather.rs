//! From ray_gradients to gradients at the active nodes, in whole numbers: they add up to the same in whatever order.
//!
//! A number is cut in two parts: one in units of the largest number that any ray_gradient adds to a node, over `steps`, and
//! what is left in units finer by `steps` again. `steps` is a power of two so small that neither sum overflows;
//! together they keep all bits of an f32.

#![allow(missing_docs)]

use crate::constants::NEAR;
use cubecl::prelude::*;

use super::rays::{NONE, RAY_GRADIENT_COLUMNS};
use super::space::{Point, grid};

/// Work-items a group.
pub(crate) const UNITS: usize = 64;

/// The bits of the smallest number whose unit can be divided by.
const SMALLEST: u32 = 0x1000_0000;

/// The unit of the first part, given the bits of the largest number: a power of two.
#[cube]
fn unit(most: u32, steps: f32) -> f32 {
    f32::reinterpret(most & 0x7f80_0000u32) * 2.0f32 / steps
}

/// Adds a number to the two sums from `at` on.
#[cube]
fn add(sums: &mut [Atomic<i32>], at: usize, number: f32, unit: f32, steps: f32) {
    let whole = (number / unit).round();
    let rest = (number / unit - whole) * steps;
    sums[at].fetch_add(i32::cast_from(whole));
    sums[at + 1].fetch_add(i32::cast_from(rest.round()));
}

/// The number that two sums from `at` on make; they are zero afterwards.
#[cube]
fn taken(sums: &mut [i32], at: usize, most: u32, steps: f32) -> f32 {
    let unit = unit(most, steps);
    let number = f32::cast_from(sums[at]) * unit + f32::cast_from(sums[at + 1]) * (unit / steps);
    sums[at] = 0i32;
    sums[at + 1] = 0i32;
    number
}

/// Adds up what the ray_gradients say of the corners of their cells.
#[cube(launch)]
pub(crate) fn scatter(
    ray_gradients: &[f32],
    most: &[u32],
    shape_slots: &[u32],
    color_slots: &[u32],
    shape_sums: &mut [Atomic<i32>],
    color_sums: &mut [Atomic<i32>],
    count: u32,
    shape_nodes: u32,
    color_nodes: u32,
    half_extent: f32,
    steps: f32,
) {
    let ray = ABSOLUTE_POS;
    if ray < count as usize {
        let at = ray * RAY_GRADIENT_COLUMNS;
        let point = Point::new(ray_gradients[at], ray_gradients[at + 1], ray_gradients[at + 2]);
        let grad_value = ray_gradients[at + 3];
        if most[0] > SMALLEST && grad_value.abs() > 0.0f32 {
            let shape = grid(shape_nodes, half_extent);
            let cell = shape.locate(&point);
            let unit = unit(most[0], steps);
            #[unroll]
            for corner in 0..8usize {
                let slot = shape_slots[shape.corner(cell.node, corner)];
                if slot != NONE {
                    add(shape_sums, 2 * slot as usize, cell.weight(corner) * grad_value, unit, steps);
                }
            }
        }
        let grad_color = Point::new(ray_gradients[at + 4], ray_gradients[at + 5], ray_gradients[at + 6]);
        if most[1] > SMALLEST && grad_color.size() > 0.0f32 {
            let color = grid(color_nodes, half_extent);
            let cell = color.locate(&point);
            let unit = unit(most[1], steps);
            #[unroll]
            for corner in 0..8usize {
                let slot = color_slots[color.corner(cell.node, corner)];
                if slot != NONE {
                    let (weight, sum) = (cell.weight(corner), 6 * slot as usize);
                    add(color_sums, sum, weight * grad_color.x, unit, steps);
                    add(color_sums, sum + 2, weight * grad_color.y, unit, steps);
                    add(color_sums, sum + 4, weight * grad_color.z, unit, steps);
                }
            }
        }
    }
}

/// How much larger the mean of a node's six neighbours is.
#[cube]
fn excess(values: &[f32], node: usize, nodes: usize) -> f32 {
    let plane = nodes * nodes;
    let sum = values[node - 1]
        + values[node + 1]
        + values[node - nodes]
        + values[node + nodes]
        + values[node - plane]
        + values[node + plane];
    sum / 6.0f32 - values[node]
}

/// The gradient by the shape, and the slope of each node's smoothness. `most[2]` becomes the number of nodes near the
/// surface, and `smoothness [groups]` the sum of their smoothness in each group of work-items.
#[cube(launch)]
pub(crate) fn gather_shape(
    active: &[u32],
    values: &[f32],
    sums: &mut [i32],
    most: &mut [Atomic<u32>],
    gradient: &mut [f32],
    slopes: &mut [f32],
    smoothness: &mut [f32],
    count: u32,
    nodes: u32,
    spacing: f32,
    knee: f32,
    steps: f32,
) {
    let mut shares = Shared::<[f32]>::new_slice(UNITS);
    let mut near = Shared::<[u32]>::new_slice(UNITS);
    let slot = ABSOLUTE_POS;
    let unit = UNIT_POS as usize;
    shares[unit] = 0.0f32;
    near[unit] = 0u32;
    if slot < count as usize {
        gradient[slot] = taken(sums, 2 * slot, most[0].load(), steps);
        let node = active[slot] as usize;
        let laplacian = excess(values, node, nodes as usize) / spacing;
        let is_near = values[node].abs() <= NEAR * spacing;
        let slope = select(is_near, laplacian.max(-knee).min(knee), 0.0f32);
        slopes[slot] = slope;
        // The Huber function by its slope: s^2 / 2 within the knee, and s beyond it for each further unit.
        shares[unit] = slope * (laplacian - 0.5f32 * slope);
        near[unit] = select(is_near, 1u32, 0u32);
    }
    sync_cube();
    // There may be more groups than nodes need.
    if unit == 0 && slot < count as usize {
        let mut sum = 0.0f32;
        let mut nearby = 0u32;
        for i in 0..UNITS {
            sum += shares[i];
            nearby += near[i];
        }
        smoothness[CUBE_POS] = sum;
        if nearby > 0u32 {
            most[2].fetch_add(nearby);
        }
    }
}

/// What a neighbour's slope is; zero where it is not active.
#[cube]
fn slope_at(slots: &[u32], slopes: &[f32], node: usize) -> f32 {
    let slot = slots[node];
    let mut slope = 0.0f32;
    if slot != NONE {
        slope = slopes[slot as usize];
    }
    slope
}

/// Adds the gradient of `weight` times the mean smoothness.
#[cube(launch)]
pub(crate) fn spread(
    active: &[u32],
    slots: &[u32],
    slopes: &[f32],
    most: &[u32],
    gradient: &mut [f32],
    count: u32,
    nodes: u32,
    spacing: f32,
    weight: f32,
) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize && most[2] > 0u32 {
        let (node, nodes) = (active[slot] as usize, nodes as usize);
        let plane = nodes * nodes;
        let sum = slope_at(slots, slopes, node - 1)
            + slope_at(slots, slopes, node + 1)
            + slope_at(slots, slopes, node - nodes)
            + slope_at(slots, slopes, node + nodes)
            + slope_at(slots, slopes, node - plane)
            + slope_at(slots, slopes, node + plane);
        let scale = weight / (f32::cast_from(most[2]) * spacing);
        gradient[slot] += scale * (sum / 6.0f32 - slopes[slot]);
    }
}

/// The gradient by the colour, with a pull of this weight towards a colour.
#[cube(launch)]
pub(crate) fn gather_color(
    active: &[u32],
    values: &[f32],
    sums: &mut [i32],
    most: &[u32],
    gradient: &mut [f32],
    count: u32,
    red: f32,
    green: f32,
    blue: f32,
    weight: f32,
    steps: f32,
) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        let node = 3 * active[slot] as usize;
        let at = 3 * slot;
        gradient[at] = taken(sums, 2 * at, most[1], steps) + weight * (values[node] - red);
        gradient[at + 1] = taken(sums, 2 * at + 2, most[1], steps) + weight * (values[node + 1] - green);
        gradient[at + 2] = taken(sums, 2 * at + 4, most[1], steps) + weight * (values[node + 2] - blue);
    }
}
