//! Sets of nodes, a bit each: those inside, the corners of the cells that a surface passes through, those near others.

use dvr_core::voxel::VoxelGrid;
use rayon::prelude::*;

use super::layout::EDGE;
use super::occupancy::BrickOccupancy;
use crate::active::ActiveNodes;

/// A set of nodes, a bit each, in rows of whole words along x. Beyond the grid there are none.
#[derive(Clone, Debug)]
pub(crate) struct NodeSet {
    nodes: usize,
    /// Words of a row.
    words: usize,
    bits: Vec<u64>,
}

/// How far before the first of eight nodes a [`NodeSet::window`] begins.
pub(crate) const BEFORE: usize = 2;

impl NodeSet {
    pub fn new(grid: &VoxelGrid) -> Self {
        let (nodes, words) = (grid.nodes(), grid.nodes().div_ceil(64));
        Self { nodes, words, bits: vec![0; words * nodes * nodes] }
    }

    /// The nodes that are not negative.
    pub fn inside(grid: &VoxelGrid, occupancy: &BrickOccupancy) -> Self {
        let mut set = Self::new(grid);
        let plane = set.words * set.nodes;
        set.bits.par_chunks_mut(plane).enumerate().for_each(|(z, rows)| occupancy.write_inside(z, rows));
        set
    }

    pub fn set(&mut self, [x, y, z]: [usize; 3]) {
        self.bits[(z * self.nodes + y) * self.words + x / 64] |= 1 << (x % 64);
    }

    pub fn contains(&self, [x, y, z]: [usize; 3]) -> bool {
        self.bits[(z * self.nodes + y) * self.words + x / 64] >> (x % 64) & 1 == 1
    }

    /// Whether a node that may lie beyond the grid is in the set.
    pub fn has(&self, at: [isize; 3]) -> bool {
        let within = at.iter().all(|&at| at >= 0 && (at as usize) < self.nodes);
        within && self.contains(at.map(|at| at as usize))
    }

    /// Twelve nodes of a row from [`BEFORE`] before `x`, a multiple of eight, on: the first in the lowest bit.
    pub fn window(&self, x: usize, y: isize, z: isize) -> u32 {
        let nodes = self.nodes as isize;
        if !(0..nodes).contains(&y) || !(0..nodes).contains(&z) {
            return 0;
        }
        let first = (z as usize * self.nodes + y as usize) * self.words;
        let row = &self.bits[first..first + self.words];
        let word = |at: usize| row.get(at).copied().unwrap_or(0);
        let at = x / 64;
        let before = at.checked_sub(1).map_or(0, word) >> (64 - BEFORE);
        let all = u128::from(before) | u128::from(word(at)) << BEFORE | u128::from(word(at + 1)) << (64 + BEFORE);
        (all >> (x % 64)) as u32 & 0xfff
    }

    pub fn count(&self) -> usize {
        self.bits.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// All of them, in rising order.
    pub fn iter(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        self.bits.iter().enumerate().flat_map(move |(index, &word)| {
            let (row, first) = (index / self.words, index % self.words * 64);
            let mut word = word;
            std::iter::from_fn(move || {
                let bit = (word != 0).then(|| word.trailing_zeros() as usize)?;
                word &= word - 1;
                Some([first + bit, row % self.nodes, row / self.nodes])
            })
        })
    }

    /// The same as runs.
    pub fn active(&self, grid: &VoxelGrid) -> ActiveNodes {
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for at in self.iter() {
            let node = grid.index(at);
            match runs.last_mut() {
                Some((start, length)) if (*start + *length) as usize == node && at[0] > 0 => *length += 1,
                _ => runs.push((node as u32, 1)),
            }
        }
        ActiveNodes::of_runs(grid, runs.into_iter())
    }

    /// The corners of the cells of which some corners are in this set and some are not.
    pub fn around_surface(&self) -> Self {
        let Self { nodes, words, ref bits } = *self;
        let row = |y: usize, z: usize| &bits[(z * nodes + y) * words..][..words];
        // A bit for each such cell, at its lowest node.
        let mut crossed = vec![0u64; bits.len()];
        crossed.par_chunks_mut(words * nodes).enumerate().filter(|(z, _)| z + 1 < nodes).for_each(|(z, layer)| {
            for (y, out) in layer.chunks_mut(words).enumerate().filter(|(y, _)| y + 1 < nodes) {
                let rows = [row(y, z), row(y + 1, z), row(y, z + 1), row(y + 1, z + 1)];
                let any = |word: usize| rows.iter().fold(0, |all, row| all | row.get(word).copied().unwrap_or(0));
                let all = |word: usize| rows.iter().fold(!0, |all, row| all & row.get(word).copied().unwrap_or(0));
                for (word, out) in out.iter_mut().enumerate() {
                    let some = any(word) | any(word) >> 1 | any(word + 1) << 63;
                    let every = all(word) & (all(word) >> 1 | all(word + 1) << 63);
                    let cells = (nodes - 1).saturating_sub(64 * word).min(64);
                    let there = if cells == 64 { !0 } else { (1 << cells) - 1 };
                    *out = some & !every & there;
                }
            }
        });
        let cells = |y: usize, z: usize| &crossed[(z * nodes + y) * words..][..words];
        let mut corners = vec![0u64; bits.len()];
        corners.par_chunks_mut(words * nodes).enumerate().for_each(|(z, layer)| {
            for (y, out) in layer.chunks_mut(words).enumerate() {
                for (y, z) in [z.checked_sub(1), Some(z)]
                    .into_iter()
                    .flatten()
                    .flat_map(|z| [y.checked_sub(1), Some(y)].into_iter().flatten().map(move |y| (y, z)))
                {
                    let mut carry = 0;
                    for (out, &cells) in out.iter_mut().zip(cells(y, z)) {
                        *out |= cells | cells << 1 | carry;
                        carry = cells >> 63;
                    }
                }
            }
        });
        Self { nodes, words, bits: corners }
    }

    /// Words that hold the rows of a brick, how far its nodes are shifted in them, and the bits of these without the shift.
    fn words_of_brick(&self, brick: [usize; 3]) -> (impl Iterator<Item = usize> + use<>, usize, u64) {
        let Self { nodes, words, .. } = *self;
        let [x, y, z] = brick.map(|at| EDGE * at);
        let range = move |from: usize| from..(from + EDGE).min(nodes);
        let indices = range(z).flat_map(move |z| range(y).map(move |y| (z * nodes + y) * words + x / 64));
        (indices, x % 64, (1 << (nodes - x).min(EDGE)) - 1)
    }

    /// Puts all nodes of a brick into the set.
    pub fn fill_brick(&mut self, brick: [usize; 3]) {
        let (indices, shift, nodes) = self.words_of_brick(brick);
        indices.for_each(|index| self.bits[index] |= nodes << shift);
    }

    /// Whether all, or none, of the nodes of a brick are in the set; neither where some are.
    pub fn side_of_brick(&self, brick: [usize; 3]) -> Option<bool> {
        let (indices, shift, nodes) = self.words_of_brick(brick);
        let [mut some, mut all] = [false, true];
        for index in indices {
            let bits = self.bits[index] >> shift & nodes;
            (some, all) = (some || bits != 0, all && bits == nodes);
        }
        (some == all).then_some(all)
    }

    /// The nodes that have one of these at most `before` nodes before or `after` nodes after them along each axis.
    pub fn grown(self, before: usize, after: usize) -> Self {
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
    pub fn without_border(mut self) -> Self {
        let Self { nodes, words, .. } = self;
        let last = nodes - 1;
        self.bits.par_chunks_mut(words).enumerate().with_min_len(nodes).for_each(|(row, bits)| {
            let is_inner = |at: usize| at > 0 && at < last;
            if !is_inner(row % nodes) || !is_inner(row / nodes) {
                bits.fill(0);
            }
            bits[0] &= !1;
            for (word, bits) in bits.iter_mut().enumerate() {
                let inner = last.saturating_sub(64 * word).min(64);
                *bits &= if inner == 64 { !0 } else { (1 << inner) - 1 };
            }
        });
        self
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn corners_of_crossed_cells_bricks_and_windows_are_those_of_single_nodes() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for (nodes, share) in [(2, 0.5), (9, 0.02), (9, 0.98), (65, 0.001), (70, 0.5), (129, 0.0005)] {
            let grid = VoxelGrid::new(nodes, 0.5);
            let mut set = NodeSet::new(&grid);
            (0..grid.len()).filter(|_| rng.random_bool(share)).for_each(|node| set.set(grid.coordinates(node)));
            let mut expected = NodeSet::new(&grid);
            for cell in 0..grid.cells().pow(3) {
                let [x, y, z] = [cell, cell / grid.cells(), cell / grid.cells().pow(2)].map(|at| at % grid.cells());
                let corners: [_; 8] = std::array::from_fn(|i| [x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)]);
                let inside = corners.iter().filter(|&&at| set.contains(at)).count();
                if inside % 8 > 0 {
                    corners.iter().for_each(|&at| expected.set(at));
                }
            }
            let found = set.around_surface();
            assert!(found.bits == expected.bits, "{nodes} nodes");
            assert_eq!(found.iter().count(), found.count());
            let (y, z) = (nodes as isize / 2, nodes as isize - 1);
            for x in (0..nodes).step_by(EDGE) {
                let bit = |i: usize| u32::from(set.has([(x + i) as isize - BEFORE as isize, y, z])) << i;
                assert_eq!(set.window(x, y, z), (0..12).map(bit).sum::<u32>(), "{nodes} nodes, from {x}");
            }
            assert_eq!(set.window(0, -1, z), 0);
            let edge = nodes.div_ceil(EDGE);
            for index in 0..edge.pow(3) {
                let brick = [index % edge, index / edge % edge, index / (edge * edge)];
                let [xs, ys, zs] = brick.map(|at| EDGE * at..(EDGE * (at + 1)).min(nodes));
                let all: Vec<_> = zs
                    .flat_map(|z| {
                        ys.clone().flat_map({
                            let xs = xs.clone();
                            move |y| xs.clone().map(move |x| [x, y, z])
                        })
                    })
                    .collect();
                let inside = all.iter().filter(|&&at| set.contains(at)).count();
                let expected = [0, all.len()].contains(&inside).then_some(inside > 0);
                assert_eq!(set.side_of_brick(brick), expected, "{nodes} nodes, {brick:?}");
                let mut filled = NodeSet::new(&grid);
                filled.fill_brick(brick);
                assert!(filled.count() == all.len() && all.iter().all(|&at| filled.contains(at)));
                if nodes > 70 && index > 20 {
                    break;
                }
            }
        }
    }
}
