//! From ray gradients at points to gradients at nodes: the counterpart of `step::cpu::gather`. In whole numbers, which
//! add up to the same in whatever order.
//!
//! A number is cut in two parts: one in units of the largest number that any ray gradient adds to a node, over `steps`,
//! and the remainder in units finer by `steps` again. `steps` is a power of two so small that neither sum overflows;
//! together they keep all bits of an f32.

#![allow(missing_docs)]

use cubecl::prelude::*;

use crate::color::CHANNELS;
use crate::color::gpu::Channels;
use crate::gpu::launch::NONE;
use crate::gpu::voxel::{Point, grid};
use crate::step::record::NUMBERS;
use crate::step::record::numbers::{GRAD_COLOR, GRAD_VALUE, POINT};

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

/// Adds up the ray gradients at the corners of their cells.
#[cube(launch)]
pub(crate) fn scatter(
    records: &[f32],
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
        let at = ray * NUMBERS;
        let point = Point::new(records[at + POINT], records[at + POINT + 1], records[at + POINT + 2]);
        let grad_value = records[at + GRAD_VALUE];
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
        let mut size = 0.0f32;
        #[unroll]
        for c in 0..CHANNELS {
            size += records[at + GRAD_COLOR + c].abs();
        }
        if most[1] > SMALLEST && size > 0.0f32 {
            let color = grid(color_nodes, half_extent);
            let cell = color.locate(&point);
            let unit = unit(most[1], steps);
            #[unroll]
            for corner in 0..8usize {
                let slot = color_slots[color.corner(cell.node, corner)];
                if slot != NONE {
                    let (weight, sum) = (cell.weight(corner), 2 * CHANNELS * slot as usize);
                    #[unroll]
                    for c in 0..CHANNELS {
                        add(color_sums, sum + 2 * c, weight * records[at + GRAD_COLOR + c], unit, steps);
                    }
                }
            }
        }
    }
}

/// The gradient by the shape.
#[cube(launch)]
pub(crate) fn gather_shape(sums: &mut [i32], most: &[u32], gradient: &mut [f32], count: u32, steps: f32) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        gradient[slot] = taken(sums, 2 * slot, most[0], steps);
    }
}

/// The gradient by the colour, with a pull of this weight towards the colour of rest.
#[cube(launch)]
pub(crate) fn gather_color(
    active: &[u32],
    values: &[f32],
    sums: &mut [i32],
    most: &[u32],
    gradient: &mut [f32],
    count: u32,
    rest: Channels,
    weight: f32,
    steps: f32,
) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        let node = CHANNELS * active[slot] as usize;
        let at = CHANNELS * slot;
        #[unroll]
        for c in 0..CHANNELS {
            let pull = weight * (values[node + c] - rest.at(c));
            gradient[at + c] = taken(sums, 2 * (at + c), most[1], steps) + pull;
        }
    }
}
