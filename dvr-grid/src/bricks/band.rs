//! The nodes near the surface of values that are interpolated from a grid of half the cells.

use dvr_core::voxel::VoxelGrid;
use rayon::prelude::*;

use super::occupancy::BrickOccupancy;
use super::values::BrickValues;
use crate::active::ActiveNodes;

/// The nodes of a grid that are at most `reach` nodes away, along each axis, from one with a neighbour of another sign;
/// none of the grid's border. `coarser` has half the cells of the grid, whose values are interpolated from it: only in
/// cells of it that the surface passes through are there such neighbours.
pub(crate) fn near_refined_surface(grid: &VoxelGrid, coarser: &BrickValues<1>, reach: usize) -> ActiveNodes {
    let mut near = NodeBits::new(grid);
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
    near.grown(reach + 1, reach).into_active(grid)
}

/// A bit for every node of a grid, in rows of whole words.
struct NodeBits {
    nodes: usize,
    /// Words of a row.
    words: usize,
    bits: Vec<u64>,
}

impl NodeBits {
    fn new(grid: &VoxelGrid) -> Self {
        let (nodes, words) = (grid.nodes(), grid.nodes().div_ceil(64));
        Self { nodes, words, bits: vec![0; words * nodes * nodes] }
    }

    fn set(&mut self, [x, y, z]: [usize; 3]) {
        self.bits[(z * self.nodes + y) * self.words + x / 64] |= 1 << (x % 64);
    }

    /// The nodes that have one of these at most `before` nodes before or `after` nodes after them along each axis.
    fn grown(self, before: usize, after: usize) -> Self {
        assert!(before < 64 && after < 64, "shifts within a word");
        let Self { nodes, words, bits } = self;
        let plane = words * nodes;
        let mut along_x = vec![0; bits.len()];
        along_x.par_chunks_mut(words).zip(bits.par_chunks(words)).with_min_len(nodes).for_each(|(to, row)| {
            for (i, to) in to.iter_mut().enumerate() {
                let (last, next) = (i.checked_sub(1).map_or(0, |i| row[i]), row.get(i + 1).copied().unwrap_or(0));
                *to = row[i];
                (1..=before).for_each(|by| *to |= row[i] << by | last >> (64 - by));
                (1..=after).for_each(|by| *to |= row[i] >> by | next << (64 - by));
            }
        });
        let grow = |from: &[u64], stride: usize| {
            let mut grown = vec![0; from.len()];
            grown.par_chunks_mut(words).enumerate().with_min_len(nodes).for_each(|(row, to)| {
                let at = row * words / stride % nodes;
                for other in at.saturating_sub(before)..=(at + after).min(nodes - 1) {
                    let start = row * words + other * stride - at * stride;
                    to.iter_mut().zip(&from[start..start + words]).for_each(|(to, from)| *to |= from);
                }
            });
            grown
        };
        let along_y = grow(&along_x, words);
        Self { nodes, words, bits: grow(&along_y, plane) }
    }

    /// Those that are not on the border of the grid.
    fn into_active(self, grid: &VoxelGrid) -> ActiveNodes {
        let inner = 1..self.nodes - 1;
        let runs = self.bits.chunks(self.words).enumerate().filter(|(row, words)| {
            let (y, z) = (row % self.nodes, row / self.nodes);
            inner.contains(&y) && inner.contains(&z) && words.iter().any(|&word| word != 0)
        });
        let runs = runs.flat_map(|(row, words)| {
            let is_set = |x: usize| words[x / 64] >> (x % 64) & 1 == 1;
            let mut found = Vec::new();
            let mut x = inner.start;
            while x < inner.end {
                // Whole words without a node are passed over at once.
                if words[x / 64] >> (x % 64) == 0 {
                    x = (x / 64 + 1) * 64;
                    continue;
                }
                let start = x;
                while x < inner.end && is_set(x) {
                    x += 1;
                }
                if x > start {
                    found.push(((row * self.nodes + start) as u32, (x - start) as u32));
                } else {
                    x += 1;
                }
            }
            found
        });
        ActiveNodes::of_runs(grid, runs)
    }
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
