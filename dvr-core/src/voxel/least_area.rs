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
    // The most that each node may become. Rows of nodes are told apart by whether any of theirs may be solid: where none is,
    // nothing changes, and a hull seldom fills more than a third of its cube.
    let most: Vec<f32> = is_inside.iter().map(|&inside| if inside { 1.0 } else { 0.0 }).collect();
    let solid_rows: Vec<bool> = is_inside.chunks(nodes).map(|row| row.contains(&true)).collect();
    let beside = |row: usize, stride: usize| solid_rows.get(row + stride).copied().unwrap_or(false);
    let dual_rows: Vec<bool> =
        (0..nodes * nodes).map(|row| solid_rows[row] || beside(row, 1) || beside(row, nodes)).collect();
    let mut solid: Vec<f32> = most.iter().map(|most| 0.5 * most).collect();
    let mut ahead = solid.clone();
    let [mut along_x, mut along_y, mut along_z] = [(); 3].map(|()| vec![0f32; grid.len()]);
    let nothing = vec![0f32; nodes];
    let of = |row: usize| row * nodes..(row + 1) * nodes;
    for _ in 0..ITERATIONS {
        cancellation.check()?;
        let planes =
            along_x.par_chunks_mut(plane).zip(along_y.par_chunks_mut(plane)).zip(along_z.par_chunks_mut(plane));
        planes.enumerate().for_each(|(z, ((along_x, along_y), along_z))| {
            let rows = along_x.chunks_mut(nodes).zip(along_y.chunks_mut(nodes)).zip(along_z.chunks_mut(nodes));
            for (y, ((x_flow, y_flow), z_flow)) in rows.enumerate().filter(|(y, _)| dual_rows[z * nodes + y]) {
                let row = z * nodes + y;
                let here = &ahead[of(row)];
                climb(&mut x_flow[..nodes - 1], &here[1..], here);
                if y + 1 < nodes {
                    climb(y_flow, &ahead[of(row + 1)], here);
                }
                if z + 1 < nodes {
                    climb(z_flow, &ahead[of(row + nodes)], here);
                }
                shorten([x_flow, y_flow, z_flow]);
            }
        });
        let rows = solid.par_chunks_mut(plane).zip(ahead.par_chunks_mut(plane)).enumerate();
        rows.for_each(|(z, (solid, ahead))| {
            let rows = solid.chunks_mut(nodes).zip(ahead.chunks_mut(nodes)).enumerate();
            for (y, (solid, ahead)) in rows.filter(|(y, _)| solid_rows[z * nodes + y]) {
                let row = z * nodes + y;
                let flows = [&along_x[of(row)], &along_y[of(row)], &along_z[of(row)]];
                let y_before = if y > 0 { &along_y[of(row - 1)] } else { &nothing[..] };
                let z_before = if z > 0 { &along_z[of(row - nodes)] } else { &nothing[..] };
                descend([solid, ahead], flows, [y_before, z_before], [&price[of(row)], &most[of(row)]]);
            }
        });
    }
    Ok(solid.into_iter().map(|solid| solid >= 0.5).collect())
}

/// A step of a row of flows along an axis, up the slope from `here` to the nodes that come `next`.
fn climb(flow: &mut [f32], next: &[f32], here: &[f32]) {
    for ((flow, next), here) in flow.iter_mut().zip(next).zip(here) {
        *flow += STEP * (next - here);
    }
}

/// Flows of a row of nodes, made no longer than the price of area.
fn shorten([x, y, z]: [&mut [f32]; 3]) {
    for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
        let length = (*x * *x + *y * *y + *z * *z).sqrt();
        let scale = (length / AREA).max(1.0).recip();
        *x *= scale;
        *y *= scale;
        *z *= scale;
    }
}

/// A step of a row of nodes, `solid` and as it will be `ahead`, with the flows out of them, those into them along y and z, and
/// what nodes cost and may become at most.
fn descend(
    [solid, ahead]: [&mut [f32]; 2],
    [x, y, z]: [&[f32]; 3],
    [y_before, z_before]: [&[f32]; 2],
    [price, most]: [&[f32]; 2],
) {
    let len = solid.len();
    let [y, z, y_before, z_before, price, most] = [y, z, y_before, z_before, price, most].map(|row| &row[..len]);
    let (x, ahead) = (&x[..len], &mut ahead[..len]);
    let mut step = |i: usize, x_before: f32| {
        let divergence = (x[i] - x_before) + (y[i] - y_before[i]) + (z[i] - z_before[i]);
        let next = (solid[i] + STEP * (divergence - price[i])).max(0.0).min(most[i]);
        ahead[i] = 2.0 * next - solid[i];
        solid[i] = next;
    };
    step(0, 0.0);
    for i in 1..len {
        step(i, x[i - 1]);
    }
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
