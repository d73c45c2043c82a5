//! Where a fast run starts: the visual hull as a distance at the nodes of a lattice.

use dvr_core::hull::{MaskDistance, hull_distance};
use dvr_kernels::{ActiveNodes, Lattice};
use rayon::prelude::*;

/// Distances are known up to this, object units.
const REACH: f32 = 0.1;

/// Cells around the hull in which the surface may move.
const BAND_CELLS: f32 = 2.5;

/// Distance to the hull at every node (positive inside), and the nodes at which the shape may change: the hull and a band
/// around it. What lies outside stays outside.
pub(super) fn hull_start(masks: &[MaskDistance], lattice: &Lattice, disagreeing: usize) -> (Vec<f32>, ActiveNodes) {
    let last = lattice.nodes() - 1;
    let on_border = |node: usize| lattice.coordinates(node).iter().any(|&c| c == 0 || c == last);
    let distances: Vec<f32> = (0..lattice.len())
        .into_par_iter()
        .map(|node| {
            let distance = hull_distance(masks, lattice.position(node), REACH, disagreeing);
            // The border of the cube is outside: a surface is closed there.
            if on_border(node) { distance.min(-0.5 * lattice.spacing()) } else { distance }
        })
        .collect();
    let band = BAND_CELLS * lattice.spacing();
    let active = ActiveNodes::new(lattice, |node| distances[node] > -band && !on_border(node));
    (distances, active)
}
