//! From ray gradients at points to gradients at nodes.

use crate::active::ActiveNodes;
use dvr_core::voxel::{Cell, VoxelGrid};
use rayon::prelude::*;

use super::rays::RayGradient;
use crate::color::CHANNELS;

/// Layers of nodes that one task gathers.
const LAYERS: usize = 4;

/// Adds up the ray gradients by the shape at each active node; `gradient` is overwritten there.
///
/// Each task owns some layers and reads all ray gradients, so sums have one order whatever the threads do.
pub(crate) fn gather_shape(
    ray_gradients: &[RayGradient],
    active: &ActiveNodes,
    is_active: &[bool],
    gradient: &mut [f32],
) {
    gather::<1>(
        ray_gradients,
        active,
        is_active,
        gradient,
        |ray_gradient| ray_gradient.shape_cell,
        |ray_gradient| ray_gradient.shape_cell.weights().map(|weight| [weight * ray_gradient.grad_value]),
    );
}

/// The same for the colour.
pub(crate) fn gather_color(
    ray_gradients: &[RayGradient],
    active: &ActiveNodes,
    is_active: &[bool],
    gradient: &mut [f32],
) {
    let corners = |ray_gradient: &RayGradient| {
        ray_gradient.color_cell.weights().map(|weight| ray_gradient.grad_color.map(|gradient| weight * gradient))
    };
    gather::<CHANNELS>(ray_gradients, active, is_active, gradient, |ray_gradient| ray_gradient.color_cell, corners);
}

fn gather<const C: usize>(
    ray_gradients: &[RayGradient],
    active: &ActiveNodes,
    is_active: &[bool],
    gradient: &mut [f32],
    cell: impl Fn(&RayGradient) -> Cell + Sync,
    corners: impl Fn(&RayGradient) -> [[f32; C]; 8] + Sync,
) {
    let grid: &VoxelGrid = active.grid();
    let plane = grid.nodes() * grid.nodes();
    let offsets = grid.corner_offsets();
    gradient.par_chunks_mut(LAYERS * plane * C).enumerate().for_each(|(task, gradient)| {
        let layer = task * LAYERS;
        let nodes = layer * plane..layer * plane + gradient.len() / C;
        for z in layer..(layer + LAYERS).min(grid.nodes()) {
            for &(start, length) in active.layer(z) {
                let start = (start as usize - nodes.start) * C;
                gradient[start..start + length as usize * C].fill(0.0);
            }
        }
        for ray_gradient in ray_gradients {
            let first = cell(ray_gradient).node;
            if first + offsets[7] < nodes.start || first >= nodes.end {
                continue;
            }
            for (offset, value) in offsets.iter().zip(corners(ray_gradient)) {
                let node = first + offset;
                if nodes.contains(&node) && is_active[node] {
                    let at = (node - nodes.start) * C;
                    (0..C).for_each(|c| gradient[at + c] += value[c]);
                }
            }
        }
    });
}
