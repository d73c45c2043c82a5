//! Between grids of which each has half the cells of the next: interpolation up, its transpose down.

use std::ops::Range;

use rayon::prelude::*;

use crate::active::ActiveNodes;

/// Adds the trilinear interpolation of `coarse` to `fine`, at the active nodes of the fine grid; each node has `C`
/// channels, side by side.
///
/// # Panics
/// When the coarse grid has not half the cells of the fine one, or the slices are not as long as the grids.
pub fn prolong_add<const C: usize>(coarse: &[f32], fine: &mut [f32], active: &ActiveNodes) {
    let nodes = active.grid().nodes();
    let coarse_nodes = nodes / 2 + 1;
    check(coarse.len(), fine.len(), coarse_nodes, nodes, C);
    fine.par_chunks_mut(C * nodes * nodes).enumerate().for_each(|(z, layer)| {
        let mut blend = vec![0.0f32; C * coarse_nodes];
        for &(start, length) in active.layer(z) {
            let start = start as usize - z * nodes * nodes;
            let (y, x) = (start / nodes, start % nodes);
            let needed = C * (x / 2)..C * ((x + length as usize - 1).div_ceil(2) + 1);
            blend_rows(coarse, C * coarse_nodes, coarse_nodes, y, z, needed, &mut blend);
            let (values, _) = layer[C * start..C * (start + length as usize)].as_chunks_mut::<C>();
            for (x, value) in (x..).zip(values) {
                let (low, high) = (&blend[C * (x / 2)..], &blend[C * x.div_ceil(2)..]);
                (0..C).for_each(|c| value[c] += 0.5 * (low[c] + high[c]));
            }
        }
    });
}

/// The coarse rows beside fine row `(y, z)`, averaged in the range that is needed.
fn blend_rows(coarse: &[f32], width: usize, nodes: usize, y: usize, z: usize, needed: Range<usize>, blend: &mut [f32]) {
    let row = |y: usize, z: usize| &coarse[(z * nodes + y) * width..][needed.clone()];
    let ys = [y / 2, y.div_ceil(2)];
    let zs = [z / 2, z.div_ceil(2)];
    let rows = [row(ys[0], zs[0]), row(ys[1], zs[0]), row(ys[0], zs[1]), row(ys[1], zs[1])];
    for (i, value) in blend[needed.clone()].iter_mut().enumerate() {
        *value = 0.25 * (rows[0][i] + rows[1][i] + rows[2][i] + rows[3][i]);
    }
}

/// The transpose of [`prolong_add`]: the gradient by the coarse nodes, of a gradient by the fine ones that is zero
/// where they are not active. Written at the active nodes of the coarse grid.
///
/// # Panics
/// When the coarse grid has not half the cells of the fine one, or the slices are not as long as the grids.
pub fn restrict<const C: usize>(fine: &[f32], coarse: &mut [f32], coarse_active: &ActiveNodes) {
    let coarse_nodes = coarse_active.grid().nodes();
    let nodes = 2 * coarse_nodes - 1;
    check(coarse.len(), fine.len(), coarse_nodes, nodes, C);
    coarse.par_chunks_mut(C * coarse_nodes * coarse_nodes).enumerate().for_each(|(z, layer)| {
        let mut sum = vec![0.0f32; C * nodes];
        for &(start, length) in coarse_active.layer(z) {
            let start = start as usize - z * coarse_nodes * coarse_nodes;
            let (y, x) = (start / coarse_nodes, start % coarse_nodes);
            let needed = C * (2 * x).saturating_sub(1)..C * (2 * (x + length as usize)).min(nodes);
            sum_rows(fine, C * nodes, nodes, y, z, needed, &mut sum);
            let (values, _) = layer[C * start..C * (start + length as usize)].as_chunks_mut::<C>();
            for (x, value) in (x..).zip(values) {
                for (c, value) in value.iter_mut().enumerate() {
                    let left = if x > 0 { sum[C * (2 * x - 1) + c] } else { 0.0 };
                    let right = if 2 * x + 1 < nodes { sum[C * (2 * x + 1) + c] } else { 0.0 };
                    *value = sum[C * 2 * x + c] + 0.5 * (left + right);
                }
            }
        }
    });
}

/// The fine rows around coarse row `(y, z)`, weighted, in the range that is needed.
fn sum_rows(fine: &[f32], width: usize, nodes: usize, y: usize, z: usize, needed: Range<usize>, sum: &mut [f32]) {
    let sum = &mut sum[needed.clone()];
    sum.fill(0.0);
    for (dz, weight_z) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
        for (dy, weight_y) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
            let (Some(y), Some(z)) = ((2 * y + dy).checked_sub(1), (2 * z + dz).checked_sub(1)) else { continue };
            if y >= nodes || z >= nodes {
                continue;
            }
            let weight = weight_y * weight_z;
            let row = &fine[(z * nodes + y) * width..][needed.clone()];
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
        }
    }
}

fn check(coarse: usize, fine: usize, coarse_nodes: usize, nodes: usize, channels: usize) {
    assert_eq!(nodes, 2 * coarse_nodes - 1, "the coarse grid must have half the cells");
    assert_eq!((coarse, fine), (channels * coarse_nodes.pow(3), channels * nodes.pow(3)), "values per node");
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use dvr_core::voxel::VoxelGrid;

    fn random(count: usize, seed: u64) -> Vec<f32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(|_| rng.random::<f32>() - 0.5).collect()
    }

    fn is_interpolation<const C: usize>() {
        let (coarse, fine) = (VoxelGrid::new(5, 0.55), VoxelGrid::new(9, 0.55));
        let values = random(C * coarse.len(), 1);
        let mut out = vec![1.0; C * fine.len()];
        prolong_add::<C>(&values, &mut out, &ActiveNodes::new(&fine, |node| node % 3 != 0));
        for channel in 0..C {
            let one: Vec<f32> = values.iter().skip(channel).step_by(C).copied().collect();
            for (node, &found) in out.iter().skip(channel).step_by(C).enumerate() {
                let added = if node % 3 == 0 { 0.0 } else { coarse.value(&one, fine.position(node)) };
                assert!((found - 1.0 - added).abs() < 1e-5, "{node}: {found}");
            }
        }
    }

    #[test]
    fn prolongation_is_trilinear_interpolation() {
        is_interpolation::<1>();
        is_interpolation::<3>();
    }

    fn is_transpose<const C: usize>() {
        let (coarse, fine) = (VoxelGrid::new(9, 0.5), VoxelGrid::new(17, 0.5));
        let active = ActiveNodes::new(&fine, |node| node % 5 < 3);
        let (up, mut down) = (random(C * coarse.len(), 2), random(C * fine.len(), 3));
        let mut is_active = vec![false; fine.len()];
        active.iter().for_each(|node| is_active[node] = true);
        down.iter_mut().enumerate().filter(|(i, _)| !is_active[i / C]).for_each(|(_, value)| *value = 0.0);
        let mut prolonged = vec![0.0; C * fine.len()];
        prolong_add::<C>(&up, &mut prolonged, &active);
        let mut restricted = vec![0.0; C * coarse.len()];
        restrict::<C>(&down, &mut restricted, &active.coarser());
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        let (left, right) = (dot(&prolonged, &down), dot(&up, &restricted));
        assert!((left - right).abs() < 1e-4 * left.abs().max(1.0), "{left} {right}");
    }

    #[test]
    fn restriction_is_its_transpose() {
        is_transpose::<1>();
        is_transpose::<3>();
    }
}
