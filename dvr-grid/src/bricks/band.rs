//! The nodes near the surface of values that are interpolated from a grid of half the cells.

use dvr_core::voxel::VoxelGrid;

use super::node_set::NodeSet;
use super::occupancy::BrickOccupancy;
use super::values::BrickValues;
use crate::active::ActiveNodes;

/// The nodes of a grid that are at most `reach` nodes away, along each axis, from one with a neighbour of another sign;
/// none of the grid's border. `coarser` has half the cells of the grid, whose values are interpolated from it: only in
/// cells of it that the surface passes through are there such neighbours.
pub(crate) fn near_refined_surface(grid: &VoxelGrid, coarser: &BrickValues<1>, reach: usize) -> ActiveNodes {
    let mut near = NodeSet::new(grid);
    for cell in BrickOccupancy::new(coarser).crossed_cells() {
        let low = cell.map(|at| 2 * at);
        let shifted = |by: [usize; 3]| -> [usize; 3] { std::array::from_fn(|axis| low[axis] + by[axis]) };
        let signs: [bool; 27] = std::array::from_fn(|i| coarser.between(shifted([i % 3, i / 3 % 3, i / 9]))[0] >= 0.0);
        for (i, stride) in (0..27).flat_map(|i| [1, 3, 9].map(|stride| (i, stride))) {
            // Each pair of neighbours is counted at its lower node, which loses a node of reach on the upper side: it is
            // given back below.
            if i / stride % 3 < 2 && signs[i] != signs[i + stride] {
                near.set(shifted([i % 3, i / 3 % 3, i / 9]));
            }
        }
    }
    near.grown(reach + 1, reach).without_border().active(grid)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn the_band_is_that_of_all_values_whatever_the_field() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for (cells, reach) in [(4, 1), (8, 3), (16, 2), (40, 3)] {
            let (coarse, fine) = (VoxelGrid::new(cells + 1, 0.55), VoxelGrid::new(2 * cells + 1, 0.55));
            let middle = 0.3 * Vec3::new(rng.random(), rng.random(), rng.random());
            let fields: [&dyn Fn(usize, f32) -> f32; 5] = [
                &|_, noise| noise - 0.97,
                &|node, _| 0.3 - (coarse.position(node) - middle).length(),
                // A surface that leaves the cube through its border.
                &|node, _| coarse.position(node).dot(Vec3::new(0.3, 0.8, -0.2)),
                &|_, _| -1.0,
                &|_, _| 1.0,
            ];
            for (index, field) in fields.into_iter().enumerate() {
                let values: Vec<f32> = (0..coarse.len()).map(|node| field(node, rng.random())).collect();
                let coarser = BrickValues::<1>::of_grid(&coarse, &values);
                let all: Vec<f32> = (0..fine.len()).map(|node| coarser.between(fine.coordinates(node))[0]).collect();
                let found = near_refined_surface(&fine, &coarser, reach);
                assert_eq!(found, ActiveNodes::near_surface(&fine, &all, reach), "{cells} cells, field {index}");
                assert_eq!(found.count() == 0, index > 2);
            }
        }
    }
}
