//! Where a run starts: the visual hull as a distance at the nodes of a grid.

use crate::active::ActiveNodes;
use crate::multires::prolong_add;
use dvr_core::hull::{MaskDistance, hull_distance};
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, Cancelled};
use rayon::prelude::*;

use super::space_carving::SpaceCarving;
use crate::stereo::FusedDistance;

/// Distances are known up to this, object units.
const REACH: f32 = 0.1;

/// Cells around the hull in which the surface may move.
const BAND_CELLS: f32 = 2.5;

/// Adds to `values` what the hull's distance at the active nodes adds to what is interpolated of it from
/// every second node: the detail of outlines, for values that come from a grid of half the cells.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(crate) fn add_hull_detail(
    masks: &[MaskDistance],
    active: &ActiveNodes,
    disagreeing: usize,
    values: &mut [f32],
    cancellation: &Cancellation,
) -> Result<(), Cancelled> {
    let distances = |active: &ActiveNodes| -> Result<Vec<f32>, Cancelled> {
        let grid = active.grid();
        let nodes: Vec<usize> = active.iter().collect();
        let distance = |&node: &usize| {
            cancellation.check()?;
            Ok(hull_distance(masks, grid.position(node), REACH, disagreeing))
        };
        let found: Vec<f32> = nodes.par_iter().map(distance).collect::<Result<_, Cancelled>>()?;
        let mut distances = vec![0.0; grid.len()];
        nodes.iter().zip(found).for_each(|(&node, distance)| distances[node] = distance);
        Ok(distances)
    };
    let mut interpolated = vec![0.0; values.len()];
    prolong_add::<1>(&distances(&active.coarser())?, &mut interpolated, active);
    let exact = distances(active)?;
    active.iter().for_each(|node| values[node] += exact[node] - interpolated[node]);
    Ok(())
}

/// Distance to the hull at every node (positive inside), and the nodes at which the shape may change: the hull and a
/// band around it. What lies outside stays outside, what is carved starts empty, and what lies deep in it stays so.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(crate) fn hull_start(
    masks: &[MaskDistance],
    grid: &VoxelGrid,
    disagreeing: usize,
    carving: Option<&SpaceCarving>,
    fused: Option<&FusedDistance>,
    cancellation: &Cancellation,
) -> Result<(Vec<f32>, ActiveNodes), Cancelled> {
    let last = grid.nodes() - 1;
    let on_border = |node: usize| grid.coordinates(node).iter().any(|&c| c == 0 || c == last);
    let mut distances: Vec<f32> = (0..grid.len())
        .into_par_iter()
        .map(|node| {
            cancellation.check()?;
            let distance = hull_distance(masks, grid.position(node), REACH, disagreeing);
            // The border of the cube is outside: a surface is closed there.
            Ok(if on_border(node) { distance.min(-0.5 * grid.spacing()) } else { distance })
        })
        .collect::<Result<_, Cancelled>>()?;
    let band = BAND_CELLS * grid.spacing();
    let in_band = ActiveNodes::new(grid, |node| distances[node] > -band && !on_border(node));
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
