//! From gradients at points to gradients at nodes.

use dvr_core::voxel::Cell;
use rayon::prelude::*;

use super::rays::RayGradient;
use crate::bricks::{BrickLayout, EDGE, Row};
use crate::color::CHANNELS;

/// Rows that one task clears, and ray gradients whose nodes one task looks up.
const CHUNK: usize = 1 << 10;

/// Where nothing is added.
const NONE: u32 = u32::MAX;

/// Adds up the ray gradients by the shape at each active node; `gradient`, of the rows with active nodes, is
/// overwritten.
pub(crate) fn gather_shape(ray_gradients: &[RayGradient], layout: &BrickLayout, gradient: &mut [Row<1>]) {
    let corners =
        |ray_gradient: &RayGradient| ray_gradient.shape_cell.weights().map(|weight| [weight * ray_gradient.grad_value]);
    gather::<1>(ray_gradients, layout, gradient, |ray_gradient| ray_gradient.shape_cell, corners);
}

/// The same for the colour.
pub(crate) fn gather_color(ray_gradients: &[RayGradient], layout: &BrickLayout, gradient: &mut [Row<CHANNELS>]) {
    let corners = |ray_gradient: &RayGradient| {
        ray_gradient.color_cell.weights().map(|weight| ray_gradient.grad_color.map(|gradient| weight * gradient))
    };
    gather::<CHANNELS>(ray_gradients, layout, gradient, |ray_gradient| ray_gradient.color_cell, corners);
}

/// Nodes are looked up in parallel, and added to one ray after the other: sums have one order whatever the threads do.
fn gather<const C: usize>(
    ray_gradients: &[RayGradient],
    layout: &BrickLayout,
    gradient: &mut [Row<C>],
    cell: impl Fn(&RayGradient) -> Cell + Sync,
    corners: impl Fn(&RayGradient) -> [[f32; C]; 8],
) {
    let places = |ray_gradient: &RayGradient| -> [u32; 8] {
        let [x, y, z] = layout.grid().coordinates(cell(ray_gradient).node);
        std::array::from_fn(|corner| {
            let at = [x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)];
            layout.active_slot(at).map_or(NONE, |(slot, lane)| (slot * EDGE + lane) as u32)
        })
    };
    let (places, ()) = rayon::join(
        || ray_gradients.par_iter().with_min_len(CHUNK).map(places).collect::<Vec<_>>(),
        || gradient.par_chunks_mut(CHUNK).for_each(|rows| rows.fill([[0.0; C]; EDGE])),
    );
    let gradient = gradient.as_flattened_mut();
    for (ray_gradient, places) in ray_gradients.iter().zip(&places) {
        for (&place, value) in places.iter().zip(corners(ray_gradient)).filter(|(place, _)| **place != NONE) {
            let at = &mut gradient[place as usize];
            (0..C).for_each(|c| at[c] += value[c]);
        }
    }
}
