//! Between levels of which each has half the cells of the next: gradients go down, Adam moves parameters, sums come up.
//! The counterpart of `multires::pyramid` and `multires::adam`.

#![allow(missing_docs)]

use crate::constants::{BETA1, BETA2, EPSILON};
use cubecl::prelude::*;

use crate::gpu::dense::Around;
use crate::gpu::launch::NONE;

/// The gradient by the active nodes of a coarse grid, from that by the active nodes of one of twice the cells.
#[cube(launch)]
pub(crate) fn restrict(
    active: &[u32],
    fine_slots: &[u32],
    fine: &[f32],
    coarse: &mut [f32],
    count: u32,
    nodes: u32,
    #[comptime] channels: usize,
) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        let node = active[slot];
        let fine_nodes = 2u32 * nodes - 1u32;
        let (x, y, z) = (2u32 * (node % nodes), 2u32 * (node / nodes % nodes), 2u32 * (node / (nodes * nodes)));
        let mut sum = Array::<f32>::new(channels);
        #[unroll]
        for c in 0..channels {
            sum[c] = 0.0f32;
        }
        for around in 0..27u32 {
            let (dx, dy, dz) = (around % 3u32, around / 3u32 % 3u32, around / 9u32);
            // One before the grid wraps around, and is as little in it as one behind.
            let (fx, fy, fz) = (x + dx - 1u32, y + dy - 1u32, z + dz - 1u32);
            if fx < fine_nodes && fy < fine_nodes && fz < fine_nodes {
                let fine_slot = fine_slots[((fz * fine_nodes + fy) * fine_nodes + fx) as usize];
                if fine_slot != NONE {
                    let weight = share(dx) * (share(dy) * share(dz));
                    #[unroll]
                    for c in 0..channels {
                        sum[c] += weight * fine[fine_slot as usize * channels + c];
                    }
                }
            }
        }
        #[unroll]
        for c in 0..channels {
            coarse[slot * channels + c] = sum[c];
        }
    }
}

/// The weight of a coarse node at a fine one: 1 where they coincide, a half beside.
#[cube]
fn share(offset: u32) -> f32 {
    select(offset == 1u32, 1.0f32, 0.5f32)
}

/// A step of Adam at the active nodes of a level, and the sum of this level, of `base` and of the coarser levels' sum
/// (where `has_coarser` is not 0) there. `rate` and `scale` are the step size and the factor of the second means
/// without their bias.
#[cube(launch)]
pub(crate) fn descend(
    active: &[u32],
    gradient: &[f32],
    base: &[f32],
    coarser: &[f32],
    parameters: &mut [f32],
    first: &mut [f32],
    second: &mut [f32],
    sums: &mut [f32],
    count: u32,
    nodes: u32,
    has_coarser: u32,
    moves: u32,
    rate: f32,
    scale: f32,
    #[comptime] channels: usize,
) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        let node = active[slot];
        let around = Around::of(node, nodes);
        #[unroll]
        for c in 0..channels {
            let i = slot * channels + c;
            if moves > 0u32 {
                let g = gradient[i];
                let m = BETA1 * first[i] + (1.0f32 - BETA1) * g;
                let v = BETA2 * second[i] + (1.0f32 - BETA2) * g * g;
                first[i] = m;
                second[i] = v;
                parameters[i] -= rate * m / ((v * scale).sqrt() + EPSILON);
            }
            let mut sum = parameters[i] + base[i];
            if has_coarser > 0u32 {
                sum += around.interpolated(coarser, c, channels);
            }
            sums[node as usize * channels + c] = sum;
        }
    }
}
