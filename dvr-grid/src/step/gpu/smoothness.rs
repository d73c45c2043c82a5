//! The kernels of the smoothness loss; its formula is in `crate::losses::smoothness`.

#![allow(missing_docs)]

use cubecl::prelude::*;

use crate::gpu::launch::UNITS;
use crate::losses::smoothness::gpu::{measure, spread};

/// The slope of each node's smoothness. `most[2]` becomes the number of nodes near the surface, and `sums [groups]` the
/// sum of their smoothness in each group of work-items.
#[cube(launch)]
pub(crate) fn slopes(
    active: &[u32],
    values: &[f32],
    most: &mut [Atomic<u32>],
    slopes: &mut [f32],
    sums: &mut [f32],
    count: u32,
    nodes: u32,
    spacing: f32,
    knee: f32,
) {
    let mut shares = Shared::<[f32]>::new_slice(UNITS);
    let mut near = Shared::<[u32]>::new_slice(UNITS);
    let slot = ABSOLUTE_POS;
    let unit = UNIT_POS as usize;
    shares[unit] = 0.0f32;
    near[unit] = 0u32;
    if slot < count as usize {
        let found = measure(values, active[slot] as usize, nodes as usize, spacing, knee);
        slopes[slot] = found.slope;
        shares[unit] = found.value;
        near[unit] = select(found.is_near, 1u32, 0u32);
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
        sums[CUBE_POS] = sum;
        if nearby > 0u32 {
            most[2].fetch_add(nearby);
        }
    }
}

/// Adds the gradient of `weight` times the mean smoothness.
#[cube(launch)]
pub(crate) fn add_gradient(
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
        let scale = weight / (f32::cast_from(most[2]) * spacing);
        gradient[slot] += scale * spread(slots, slopes, slot, active[slot] as usize, nodes as usize);
    }
}
