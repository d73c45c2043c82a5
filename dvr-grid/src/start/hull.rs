//! Where a run starts: the visual hull as a distance at the nodes of a grid.

use crate::active::ActiveNodes;
use crate::bricks::BrickValues;
use dvr_core::Cancellation;
use dvr_core::voxel::VoxelGrid;
use rayon::prelude::*;

use super::mask_distances::{MaskDistances, Nodes};
use super::space_carving::SpaceCarving;
use crate::error::Result;
use crate::stereo::FusedDistance;

/// Cells around the hull in which the surface may move.
const BAND_CELLS: f32 = 2.5;

/// What the hull's distance at the active nodes adds to what is interpolated of it from every second node, in their
/// order: the detail of outlines, for values that come from a grid of half the cells.
///
/// # Errors
/// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
pub(crate) fn hull_detail(
    masks: &MaskDistances,
    active: &ActiveNodes,
    disagreeing: usize,
    cancellation: &Cancellation,
) -> Result<Vec<f32>> {
    let distances = |active: &ActiveNodes| -> Result<Vec<f32>> {
        let nodes: Vec<usize> = active.iter().collect();
        masks.hull(active.grid(), Nodes::Some(&nodes), disagreeing, cancellation)
    };
    let coarser = active.coarser();
    let coarse = BrickValues::<1>::of_active(&coarser, &distances(&coarser)?);
    let mut detail = distances(active)?;
    let nodes: Vec<usize> = active.iter().collect();
    detail.par_iter_mut().zip(&nodes).with_min_len(1 << 12).for_each(|(detail, &node)| {
        *detail -= coarse.between(active.grid().coordinates(node))[0];
    });
    Ok(detail)
}

/// Distance to the hull at every node (positive inside), and the nodes at which the shape may change: the hull and a
/// band around it. What lies outside stays outside, what is carved starts empty, and what lies deep in it stays so.
///
/// # Errors
/// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
pub(crate) fn hull_start(
    masks: &MaskDistances,
    grid: &VoxelGrid,
    disagreeing: usize,
    carving: Option<&SpaceCarving>,
    fused: Option<&FusedDistance>,
    cancellation: &Cancellation,
) -> Result<(Vec<f32>, ActiveNodes)> {
    let mut distances = masks.hull(grid, Nodes::All, disagreeing, cancellation)?;
    for (_, distance) in distances.iter_mut().enumerate().filter(|(node, _)| grid.is_on_border(*node)) {
        // The border of the cube is outside: a surface is closed there.
        *distance = distance.min(-0.5 * grid.spacing());
    }
    let band = BAND_CELLS * grid.spacing();
    let in_band = ActiveNodes::new(grid, |node| distances[node] > -band && !grid.is_on_border(node));
    let mut may_change = vec![false; grid.len()];
    for node in in_band.iter() {
        let point = grid.position(node);
        distances[node] = distances[node].min(carving.map_or(f32::INFINITY, |carving| carving.at(point)));
        may_change[node] = !carving.is_some_and(|carving| carving.stays_empty(point));
    }
    if let Some(fused) = fused {
        in_band.iter().for_each(|node| {
            let hull = distances[node];
            distances[node] = hull.min(fused.at(grid.position(node), hull));
        });
    }
    Ok((distances, ActiveNodes::new(grid, |node| may_change[node])))
}
