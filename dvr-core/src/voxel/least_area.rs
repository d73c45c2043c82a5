//! The solid of least area that agrees with votes: a continuous minimum cut.
//!
//! Minimises `sum price * u + AREA * |grad u|` over `u` from 0 (empty) to 1 (solid) at the nodes inside a hull: convex, so
//! that its minimum is that of the surface problem, and cut at one half (Chan, Esedoglu and Nikolova 2006). Solved by
//! first-order primal-dual steps (Chambolle and Pock 2011, algorithm 1).

use rayon::prelude::*;

use super::grid::VoxelGrid;
use crate::cancellation::{Cancellation, Cancelled};

/// Price of a unit of area in spacings, where a node that all votes call empty costs 1.
const AREA: f32 = 0.1;

/// Steps of the solver.
const ITERATIONS: usize = 100;

/// Step size of both variables: their product is at most one by the squared norm of the gradient, 12.
const STEP: f32 = 0.288;

/// Whether each node is solid: `price` is what it costs to be, negative where votes want it. Where `is_inside` says no,
/// nothing is solid.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub fn least_area(
    grid: &VoxelGrid,
    price: &[f32],
    is_inside: &[bool],
    cancellation: &Cancellation,
) -> Result<Vec<bool>, Cancelled> {
    let (nodes, plane) = (grid.nodes(), grid.nodes().pow(2));
    let strides = [1, nodes, plane];
    let mut solid: Vec<f32> = is_inside.iter().map(|&inside| if inside { 0.5 } else { 0.0 }).collect();
    let mut ahead = solid.clone();
    let mut dual = vec![[0f32; 3]; grid.len()];
    for _ in 0..ITERATIONS {
        cancellation.check()?;
        dual.par_chunks_mut(plane).enumerate().for_each(|(z, dual)| {
            for (i, dual) in dual.iter_mut().enumerate() {
                let node = z * plane + i;
                let at = [i % nodes, i / nodes, z];
                for axis in 0..3 {
                    if at[axis] + 1 < nodes {
                        dual[axis] += STEP * (ahead[node + strides[axis]] - ahead[node]);
                    }
                }
                let length = dual.iter().map(|d| d * d).sum::<f32>().sqrt();
                let scale = (length / AREA).max(1.0).recip();
                dual.iter_mut().for_each(|d| *d *= scale);
            }
        });
        let rows = solid.par_chunks_mut(plane).zip(ahead.par_chunks_mut(plane)).enumerate();
        rows.for_each(|(z, (solid, ahead))| {
            for i in 0..plane {
                let node = z * plane + i;
                if !is_inside[node] {
                    continue;
                }
                let at = [i % nodes, i / nodes, z];
                let before = |axis: usize| if at[axis] > 0 { dual[node - strides[axis]][axis] } else { 0.0 };
                let divergence: f32 = (0..3).map(|axis| dual[node][axis] - before(axis)).sum();
                let next = (solid[i] + STEP * (divergence - price[node])).clamp(0.0, 1.0);
                ahead[i] = 2.0 * next - solid[i];
                solid[i] = next;
            }
        });
    }
    Ok(solid.into_iter().map(|solid| solid >= 0.5).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Solid nodes of a ball of radius 8 spacings, whose nodes cost this much.
    fn cut(price: impl Fn([f32; 3]) -> f32) -> (VoxelGrid, Vec<bool>, Vec<bool>) {
        let grid = VoxelGrid::new(25, 12.0);
        let at = |node: usize| grid.position(node).to_array();
        let is_inside: Vec<bool> = (0..grid.len()).map(|node| grid.position(node).length() < 8.0).collect();
        let prices: Vec<f32> = (0..grid.len()).map(|node| price(at(node))).collect();
        let solid = least_area(&grid, &prices, &is_inside, &Cancellation::default()).unwrap();
        (grid, is_inside, solid)
    }

    #[test]
    fn votes_that_cost_less_than_their_area_are_overruled_and_others_are_not() {
        // A bore of radius 3 through a solid whose other nodes are wanted.
        let bore = |[x, y, _]: [f32; 3]| x.hypot(y) < 3.0;
        let (grid, is_inside, solid) = cut(|at| if bore(at) { 1.0 } else { -1.0 });
        let wrong = (0..grid.len())
            .filter(|&node| is_inside[node] && solid[node] == bore(grid.position(node).to_array()))
            .count();
        let inside = is_inside.iter().filter(|&&inside| inside).count();
        assert!(wrong * 50 < inside, "{wrong} of {inside}");
        // One node that votes call empty in the middle of a solid: its area costs more.
        let (grid, is_inside, solid) = cut(|at| if at == [0.0; 3] { 0.3 } else { -0.5 });
        assert!((0..grid.len()).all(|node| solid[node] == is_inside[node]));
    }

    #[test]
    fn where_votes_are_silent_the_surface_is_flat() {
        // The lower third is wanted, the upper third is not; nothing is known of what lies between.
        let (grid, is_inside, solid) = cut(|[_, _, z]| {
            if z < -3.0 {
                -0.5
            } else if z > 3.0 {
                0.5
            } else {
                0.0
            }
        });
        for node in (0..grid.len()).filter(|&node| is_inside[node]) {
            let z = grid.position(node).z;
            assert!(z.abs() <= 3.0 || solid[node] == (z < 0.0), "{z}");
        }
    }
}
