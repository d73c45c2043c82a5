//! The colours at nodes, as steps of a quantiser: green is predicted by the nodes before it; what red and blue leave of
//! their predictions is much what green leaves.

use dvr_core::voxel::VoxelGrid;

use super::coder::{Coder, NumberModel};
use crate::bricks::NodeSet;
use crate::color::CHANNELS;

/// Layers of nodes that predictions look back to, the present one among them.
const LAYERS: usize = 2;

/// Nodes before one that predict it, and their weights. They, and what follows, are part of the format.
const NEIGHBOURS: [(i32, [isize; 3]); 9] = [
    (3, [-1, 0, 0]),
    (3, [0, -1, 0]),
    (3, [0, 0, -1]),
    (1, [-1, -1, 0]),
    (1, [1, -1, 0]),
    (1, [-1, 0, -1]),
    (1, [1, 0, -1]),
    (1, [0, -1, -1]),
    (1, [0, 1, -1]),
];

/// How far neighbours are from their mean, in quantiser steps summed over channels, less than this in each of the classes
/// but the last.
const APART: [i32; 5] = [3, 6, 10, 16, 25];
const CLASSES: usize = APART.len() + 1;

/// What another channel leaves is told apart up to this size.
const LEFT: i32 = 6;
const SIZES: usize = 2 * LEFT as usize + 1;

/// Codes the steps of the nodes of `needed`, in their order, none above `last`. A reader ignores `given`; `None`
/// where it comes to the end of its stream before.
pub(super) fn code_colors(
    coder: &mut impl Coder,
    grid: &VoxelGrid,
    needed: &NodeSet,
    last: u8,
    given: impl Fn([usize; 3]) -> [u8; CHANNELS],
) -> Option<Vec<[u8; CHANNELS]>> {
    let nodes = grid.nodes();
    let mut before = vec![[0u8; CHANNELS]; LAYERS * nodes * nodes];
    let mut green = vec![NumberModel::default(); CLASSES];
    let mut others = [vec![NumberModel::default(); CLASSES * SIZES], vec![NumberModel::default(); CLASSES * SIZES]];
    let index = |[x, y, z]: [usize; 3]| (z % LAYERS * nodes + y) * nodes + x;
    let mut code = |at: [usize; 3]| {
        if coder.is_broken() {
            return None;
        }
        let (predicted, class) = predict(needed, at, last, |at| before[index(at)]);
        let given = given(at).map(i32::from);
        let left: [i32; CHANNELS] = std::array::from_fn(|c| given[c] - predicted[c]);
        let own = green[class].code(coder, left[1]);
        let mut beside = |channel: usize, model: usize, by: i32, given: i32| {
            let size = (by.clamp(-LEFT, LEFT) + LEFT) as usize;
            predicted[channel] + own + others[model][class * SIZES + size].code(coder, given - own)
        };
        let red = beside(0, 0, own, left[0]);
        let blue = beside(2, 1, red - predicted[0] - own, left[2]);
        let color = [red, predicted[1] + own, blue].map(|step| step.clamp(0, i32::from(last)) as u8);
        before[index(at)] = color;
        Some(color)
    };
    needed.iter().map(&mut code).collect()
}

/// A prediction, and its class.
fn predict(
    needed: &NodeSet,
    at: [usize; 3],
    last: u8,
    before: impl Fn([usize; 3]) -> [u8; CHANNELS],
) -> ([i32; CHANNELS], usize) {
    let (mut sum, mut weights, mut count) = ([0; CHANNELS], 0, 0);
    let mut found = [[0; CHANNELS]; NEIGHBOURS.len()];
    for (weight, by) in NEIGHBOURS {
        let place: [isize; 3] = std::array::from_fn(|axis| at[axis] as isize + by[axis]);
        if needed.has(place) {
            found[count] = before(place.map(|at| at as usize)).map(i32::from);
            (0..CHANNELS).for_each(|c| sum[c] += weight * found[count][c]);
            (weights, count) = (weights + weight, count + 1);
        }
    }
    if count == 0 {
        return ([i32::from(last).div_euclid(2); CHANNELS], CLASSES - 1);
    }
    let mean = sum.map(|sum| (sum + weights / 2).div_euclid(weights));
    let off = |color: &[i32; CHANNELS]| (0..CHANNELS).map(|c| (color[c] - mean[c]).abs()).sum::<i32>();
    let apart = found[..count].iter().map(off).sum::<i32>() / count as i32;
    (mean, APART.iter().take_while(|&&most| apart >= most).count())
}
