//! Which cells of a grid may hold surface, and the exact first crossing of a ray with it.

use glam::Vec3;
use rayon::prelude::*;

use crate::cubic;
use dvr_core::voxel::VoxelGrid;
use dvr_core::voxel::VoxelTraversal;

/// A bit for every cell of a grid: whether one of its corners is not negative.
///
/// A trilinear function lies between the smallest and the largest of its corners, so no surface is missed by looking at
/// marked cells alone, however thin it is. A crossing is found exactly, up to the rounding of f32: on its way through a
/// cell a ray sees a cubic.
#[derive(Clone, Debug)]
pub struct OccupancyBitmask {
    grid: VoxelGrid,
    /// Nodes that are not negative, x fastest, in words of 64.
    inside: Vec<u64>,
    /// Cells, likewise.
    marked: Vec<u64>,
    /// Blocks of [`BLOCK`] cells along an edge with a marked cell, x fastest.
    blocks: Vec<bool>,
    /// Words a row.
    words: usize,
    /// The smallest box of cells around the marked ones: first, and one past the last.
    range: [[usize; 3]; 2],
}

impl OccupancyBitmask {
    /// Marks the cells of `values`.
    ///
    /// # Panics
    /// When there are not as many values as nodes.
    pub fn new(grid: &VoxelGrid, values: &[f32]) -> Self {
        let (nodes, cells) = (grid.nodes(), grid.cells());
        assert_eq!(values.len(), grid.len(), "a value per node");
        let words = nodes.div_ceil(64);
        let mut inside = vec![0; words * nodes * nodes];
        inside.par_chunks_mut(words).zip(values.par_chunks(nodes)).with_min_len(nodes).for_each(|(bits, row)| {
            write_bits(bits, row);
        });
        let marked = vec![0; words * cells * cells];
        let mut map = Self { grid: *grid, inside, marked, blocks: Vec::new(), words, range: [[0; 3]; 2] };
        map.mark();
        map
    }

    /// The grid.
    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    /// From nodes to cells.
    fn mark(&mut self) {
        let (nodes, cells, words) = (self.grid.nodes(), self.grid.cells(), self.words);
        let inside = &self.inside;
        self.marked.par_chunks_mut(words * cells).enumerate().for_each(|(z, layer)| {
            for (y, row) in layer.chunks_mut(words).enumerate() {
                let at = |dy: usize, dz: usize, word: usize| inside[((z + dz) * nodes + y + dy) * words + word];
                let any = |word: usize| at(0, 0, word) | at(1, 0, word) | at(0, 1, word) | at(1, 1, word);
                for (word, out) in row.iter_mut().enumerate() {
                    let here = any(word);
                    let carry = if word + 1 < words { any(word + 1) << 63 } else { 0 };
                    *out = here | here >> 1 | carry;
                }
            }
        });
        self.range = self.marked_range();
        self.blocks = self.marked_blocks();
    }

    fn marked_blocks(&self) -> Vec<bool> {
        let cells = self.grid.cells();
        let edge = cells.div_ceil(BLOCK);
        let mut blocks = vec![false; edge.pow(3)];
        for (i, row) in self.marked.chunks(self.words).enumerate() {
            let first = (i / cells / BLOCK * edge + i % cells / BLOCK) * edge;
            for (x, block) in blocks[first..first + edge].iter_mut().enumerate() {
                *block |= row[x * BLOCK / 64] >> (x * BLOCK % 64) & 0xff != 0;
            }
        }
        blocks
    }

    fn marked_range(&self) -> [[usize; 3]; 2] {
        let (cells, words) = (self.grid.cells(), self.words);
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for (i, row) in self.marked.chunks(words).enumerate() {
            let (Some(first), Some(last)) = (row.iter().position(|&w| w != 0), row.iter().rposition(|&w| w != 0))
            else {
                continue;
            };
            let from = [first * 64 + row[first].trailing_zeros() as usize, i % cells, i / cells];
            let to = [last * 64 + 63 - row[last].leading_zeros() as usize, i % cells, i / cells];
            for axis in 0..3 {
                low[axis] = low[axis].min(from[axis]);
                high[axis] = high[axis].max(to[axis].min(cells - 1) + 1);
            }
        }
        if high == [0; 3] { [[0; 3]; 2] } else { [low, high] }
    }

    /// Whether the surface may pass through a cell, or it is inside.
    #[inline]
    pub fn is_marked(&self, [x, y, z]: [usize; 3]) -> bool {
        self.marked[(z * self.grid.cells() + y) * self.words + x / 64] >> (x % 64) & 1 == 1
    }

    /// Ray depth, between `from` and `to`, at which the interpolated `values` (those the map was built of) first reach
    /// zero from below.
    ///
    /// `None` where they never do, and where the ray starts inside. What lies out of the cube counts as negative: a
    /// ray that enters the cube where the values are not negative crosses there.
    pub fn first_crossing(&self, values: &[f32], origin: Vec3, direction: Vec3, from: f32, to: f32) -> Option<f32> {
        first_crossing(self, values, origin, direction, from, to)
    }
}

/// Which cells of a grid may hold surface, and the values at their corners.
pub(crate) trait SurfaceCells {
    /// The values at the nodes.
    type Values: ?Sized;

    /// A block of [`BLOCK`] cells along an edge, some of which the surface may pass through, or are inside.
    type Block: Copy;

    /// The grid.
    fn grid(&self) -> &VoxelGrid;

    /// A box of cells around those that may hold surface: first, and one past the last.
    fn range(&self) -> [[usize; 3]; 2];

    /// A block, by its coordinates; `None` where the surface passes through none of its cells, and none is inside.
    fn block(&self, at: [usize; 3]) -> Option<Self::Block>;

    /// Whether the surface may pass through a cell of a block, or it is inside.
    fn is_marked(&self, block: Self::Block, cell: [usize; 3]) -> bool;

    /// The values at a cell's corners, x fastest.
    fn corners(&self, values: &Self::Values, cell: [usize; 3]) -> [f32; 8];
}

/// Cells along an edge of a block that a ray passes over at once where nothing is in it.
pub(crate) const BLOCK: usize = 8;

impl SurfaceCells for OccupancyBitmask {
    type Values = [f32];
    type Block = ();

    fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    fn range(&self) -> [[usize; 3]; 2] {
        self.range
    }

    #[inline]
    fn block(&self, [x, y, z]: [usize; 3]) -> Option<()> {
        let edge = self.grid.cells().div_ceil(BLOCK);
        self.blocks[(z * edge + y) * edge + x].then_some(())
    }

    #[inline]
    fn is_marked(&self, (): (), cell: [usize; 3]) -> bool {
        self.is_marked(cell)
    }

    #[inline]
    fn corners(&self, values: &[f32], cell: [usize; 3]) -> [f32; 8] {
        self.grid.corners(values, self.grid.index(cell))
    }
}

/// See [`OccupancyBitmask::first_crossing`].
pub(crate) fn first_crossing<S: SurfaceCells>(
    cells: &S,
    values: &S::Values,
    origin: Vec3,
    direction: Vec3,
    from: f32,
    to: f32,
) -> Option<f32> {
    let grid = cells.grid();
    let start = origin + from * direction;
    if start.abs().max_element() < grid.half_extent() {
        let cell = grid.locate(start);
        if cell.value(&cells.corners(values, grid.coordinates(cell.node))) >= 0.0 {
            return None;
        }
    }
    let mut walk = VoxelTraversal::within(grid, cells.range(), origin, direction, from, to)?;
    let (grid_origin, grid_direction) = (grid.to_grid(origin), direction / grid.spacing());
    let mut before = None;
    while let Some(cell) = walk.cell() {
        let at = cell.map(|c| c / BLOCK);
        let block = match before {
            Some((before, block)) if before == at => block,
            _ => match cells.block(at) {
                Some(block) => block,
                None => {
                    walk.skip_blocks::<BLOCK>(|at| cells.block(at).is_none());
                    continue;
                }
            },
        };
        before = Some((at, block));
        let Some(segment) = walk.next() else { break };
        if !cells.is_marked(block, cell) {
            continue;
        }
        let [x, y, z] = cell;
        let corners = cells.corners(values, segment.cell);
        let low = Vec3::new(x as f32, y as f32, z as f32);
        let at = grid_origin + segment.enter * grid_direction - low;
        let length = segment.leave - segment.enter;
        if let Some(t) = cubic::first_crossing(&along(&corners, at, length * grid_direction)) {
            return Some(segment.enter + t * length);
        }
    }
    None
}

/// Sets the bits of a row: whether each value is not negative.
fn write_bits(bits: &mut [u64], values: &[f32]) {
    for (word, values) in bits.iter_mut().zip(values.chunks(64)) {
        *word = values.iter().enumerate().fold(0, |word, (i, &value)| word | u64::from(value >= 0.0) << i);
    }
}

/// The trilinear function of `corners` on the segment from `at`, `step` long, as a cubic in `[0, 1]`.
#[inline]
fn along(c: &[f32; 8], at: Vec3, step: Vec3) -> cubic::Cubic {
    // Coefficients of 1, x, y, xy, z, xz, yz, xyz.
    let k1 = c[1] - c[0];
    let k2 = c[2] - c[0];
    let k4 = c[4] - c[0];
    let k3 = c[3] - c[2] - k1;
    let k5 = c[5] - c[4] - k1;
    let k6 = c[6] - c[4] - k2;
    let k7 = c[7] - c[6] - c[5] + c[4] - k3;
    let (a, b) = (at, step);
    // p(t) = (k0 + k1 x + k2 y + k3 xy) + z (k4 + k5 x + k6 y + k7 xy) with x, y, z linear in t.
    let quadratic = |one: f32, x: f32, y: f32, xy: f32| {
        [one + x * a.x + y * a.y + xy * a.x * a.y, x * b.x + y * b.y + xy * (a.x * b.y + a.y * b.x), xy * b.x * b.y]
    };
    let (p, q) = (quadratic(c[0], k1, k2, k3), quadratic(k4, k5, k6, k7));
    [p[0] + a.z * q[0], p[1] + a.z * q[1] + b.z * q[0], p[2] + a.z * q[2] + b.z * q[1], b.z * q[2]]
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// The slow reference: thousands of samples along the ray.
    fn sampled(grid: &VoxelGrid, values: &[f32], origin: Vec3, direction: Vec3) -> Option<f32> {
        let walk = VoxelTraversal::new(grid, origin, direction, 0.0, f32::INFINITY)?;
        let (enter, leave) = walk.fold((f32::INFINITY, 0.0), |(a, _), s| (s.enter.min(a), s.leave));
        let samples = 5000;
        let depth = |i: usize| enter + (leave - enter) * i as f32 / samples as f32;
        (0..=samples).map(depth).find(|&t| grid.value(values, origin + t * direction) >= 0.0)
    }

    fn noise(nodes: usize, offset: f32, seed: u64) -> (VoxelGrid, Vec<f32>) {
        let grid = VoxelGrid::new(nodes, 0.55);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // The border is outside: a crossing there has no root.
        let border = |node| grid.coordinates(node).iter().any(|&c| c == 0 || c == nodes - 1);
        let value = |node| {
            let inside = rng.random::<f32>() > offset && !border(node);
            rng.random::<f32>() * if inside { 1.0 } else { -1.0 }
        };
        (grid, (0..grid.len()).map(value).collect())
    }

    #[test]
    fn one_node_inside_marks_the_cells_around_it_and_no_others() {
        // Rows are stored in words of 64 cells.
        let grid = VoxelGrid::new(81, 0.55);
        for x in [10, 63, 64, 65] {
            let mut values = vec![-1.0; grid.len()];
            values[grid.index([x, 10, 50])] = 1.0;
            let mask = OccupancyBitmask::new(&grid, &values);
            assert_eq!(mask.range, [[x - 1, 9, 49], [x + 1, 11, 51]], "{x}");
            for cell in x - 2..=x + 1 {
                assert_eq!(mask.is_marked([cell, 9, 50]), (x - 1..=x).contains(&cell), "cell {cell} of node {x}");
            }
            assert!([[x, 8, 50], [x, 11, 50], [x, 9, 48], [x, 9, 51]].iter().all(|&cell| !mask.is_marked(cell)), "{x}");
        }
    }

    #[test]
    fn crossings_of_noise_are_those_of_dense_sampling() {
        for (nodes, offset) in [(9, 0.9), (20, 0.98), (67, 0.999), (65, 0.9)] {
            let (grid, values) = noise(nodes, offset, nodes as u64);
            let map = OccupancyBitmask::new(&grid, &values);
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let mut hits = 0;
            for _ in 0..300 {
                let mut random = || Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
                let origin = random().normalize() * 2.0;
                let direction = 0.4 * random() - origin;
                let found = map.first_crossing(&values, origin, direction, 0.0, f32::INFINITY);
                if let Some(expected) = sampled(&grid, &values, origin, direction) {
                    hits += 1;
                    let found = found.expect("a crossing that sampling sees");
                    assert!(found <= expected + 1e-4, "{nodes}: {found} after {expected}");
                    let value = grid.value(&values, origin + found * direction);
                    assert!(value.abs() < 2e-3, "{nodes}: {value} at {found}, sampled {expected}");
                }
            }
            assert!(hits > 10, "{nodes}: {hits}");
        }
    }

    #[test]
    fn a_sheet_of_one_layer_of_nodes_is_never_stepped_over() {
        let grid = VoxelGrid::new(129, 0.55);
        let middle = 64;
        let values: Vec<f32> =
            (0..grid.len()).map(|i| if grid.coordinates(i)[2] == middle { 1e-3 } else { -1.0 }).collect();
        let map = OccupancyBitmask::new(&grid, &values);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        for _ in 0..10_000 {
            let target = Vec3::new(rng.random::<f32>() - 0.5, rng.random::<f32>() - 0.5, 0.0);
            let origin = Vec3::new(rng.random::<f32>() * 2.0 - 1.0, rng.random::<f32>() * 2.0 - 1.0, -2.0);
            let hit = map.first_crossing(&values, origin, target - origin, 0.0, f32::INFINITY);
            // The sheet is a thousandth of a cell thick.
            assert!(hit.is_some_and(|t| (t - 1.0).abs() < 1e-4), "{hit:?}");
        }
    }

    #[test]
    fn rays_from_inside_see_nothing_and_intervals_are_kept() {
        let grid = VoxelGrid::new(17, 0.55);
        let values: Vec<f32> = (0..grid.len()).map(|i| 0.3 - grid.position(i).length()).collect();
        let map = OccupancyBitmask::new(&grid, &values);
        let cross = |origin, from, to| map.first_crossing(&values, origin, Vec3::Z, from, to);
        assert_eq!(cross(Vec3::ZERO, 0.0, 9.0), None);
        assert!(cross(Vec3::new(0.0, 0.0, -1.0), 0.0, 9.0).is_some());
        assert_eq!(cross(Vec3::new(0.0, 0.0, -1.0), 0.0, 0.5), None);
        assert_eq!(cross(Vec3::new(0.0, 0.0, -1.0), 1.4, 9.0), None);
    }

    #[test]
    fn occupied_borders_are_crossed_at_the_border() {
        let grid = VoxelGrid::new(9, 0.5);
        let values = vec![1.0; grid.len()];
        let map = OccupancyBitmask::new(&grid, &values);
        let hit = map.first_crossing(&values, Vec3::new(0.1, 0.2, -2.0), Vec3::Z, 0.0, 9.0).unwrap();
        assert!((hit - 1.5).abs() < 1e-6);
    }
}
