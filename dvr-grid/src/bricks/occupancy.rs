//! Which cells of bricks may hold surface, and the exact first crossing of a ray with it.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::layout::{Brick, BrickLayout, EDGE};
use super::values::BrickValues;
use crate::occupancy::{BLOCK, SurfaceCells, first_crossing};
use dvr_core::voxel::VoxelGrid;

/// Bits of the nodes or cells of a brick: a word for each z, in it a byte for each y.
type Bits = [u64; EDGE];

/// The lowest bit, and the seven lowest, of each byte.
const LOWEST: u64 = 0x0101_0101_0101_0101;
const LOWER: u64 = 0x7f7f_7f7f_7f7f_7f7f;

/// Cells from the first up to but without the last.
type CellBox = [[usize; 3]; 2];

/// Bricks without a marked cell, and those of which nothing is stored that lie inside.
const EMPTY: u32 = u32::MAX;
const FULL: u32 = u32::MAX - 1;

const NOTHING: CellBox = [[usize::MAX; 3], [0; 3]];

/// A bit for every cell of a grid whether one of its corners is not negative, as [`crate::OccupancyBitmask`] has: where
/// nothing of a brick is stored, one for all its cells.
#[derive(Clone, Debug)]
pub(crate) struct BrickOccupancy {
    layout: Arc<BrickLayout>,
    /// Nodes that are not negative.
    inside: Vec<Bits>,
    /// Cells.
    marked: Vec<Bits>,
    /// Of each brick of the grid, which one it is of those of which something is stored; or [`EMPTY`] or [`FULL`].
    blocks: Vec<u32>,
    /// The smallest box around the cells of bricks that are not stored and lie inside.
    of_others: CellBox,
    /// The smallest box around all marked cells.
    range: CellBox,
}

impl BrickOccupancy {
    /// Marks the cells of `values`.
    pub fn new(values: &BrickValues<1>) -> Self {
        let layout = values.layout().clone();
        let inside = layout.bricks().par_iter().map(|brick| inside(&layout, brick, values)).collect();
        let edge = layout.edge();
        let others = (0..edge.pow(3)).map(|index| [index % edge, index / edge % edge, index / (edge * edge)]);
        let blocks = others.clone().map(|at| if layout.brick(at) == Err(true) { FULL } else { EMPTY }).collect();
        let of_others = others
            .filter(|&at| layout.brick(at) == Err(true))
            .map(|at| clipped(layout.grid(), [at.map(|at| at * EDGE), at.map(|at| (at + 1) * EDGE)]))
            .fold(NOTHING, around);
        let marked = vec![[0; EDGE]; layout.bricks().len()];
        let mut occupancy = Self { layout, inside, marked, blocks, of_others, range: NOTHING };
        occupancy.mark();
        occupancy
    }

    /// Marks the cells of values that have changed at active nodes alone.
    pub fn update(&mut self, values: &BrickValues<1>) {
        let layout = &self.layout;
        self.inside.par_iter_mut().zip(layout.bricks()).with_min_len(64).for_each(|(inside, brick)| {
            for slot in brick.rows() {
                let [_, y, z] = layout.place(brick, slot);
                let (shift, word) = (y % EDGE * EDGE, &mut inside[z % EDGE]);
                *word = *word & !(0xff << shift) | signs(&values.rows()[slot]) << shift;
            }
        });
        self.mark();
    }

    /// The cells that the surface passes through, by their coordinates: one corner is not negative, another is.
    pub fn crossed_cells(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let last = self.layout.grid().cells();
        self.layout.bricks().iter().zip(&self.marked).flat_map(move |(brick, marked)| {
            let outside = cells(&self.layout, &self.inside, brick, u64::MAX);
            let crossed: Bits = std::array::from_fn(|z| marked[z] & outside[z]);
            (0..EDGE * EDGE * EDGE)
                .filter(move |bit| crossed[bit / 64] >> (bit % 64) & 1 == 1)
                .map(|bit| [bit % EDGE, bit / EDGE % EDGE, bit / 64])
                .map(|by| std::array::from_fn(|axis| brick.at[axis] * EDGE + by[axis]))
                .filter(move |at: &[usize; 3]| at.iter().all(|&at| at < last))
        })
    }

    /// Writes a bit for each node of the layer `z`, in rows of whole words: whether its value is not negative. They are zero
    /// before.
    pub fn write_inside(&self, z: usize, rows: &mut [u64]) {
        let nodes = self.layout.grid().nodes();
        for (y, row) in rows.chunks_mut(nodes.div_ceil(64)).enumerate() {
            for brick in 0..self.layout.edge() {
                let bits = match self.layout.brick([brick, y / EDGE, z / EDGE]) {
                    Ok(index) => self.inside[index][z % EDGE] >> (y % EDGE * EDGE) & 0xff,
                    // Rows end where the grid does.
                    Err(true) => 0xff >> (EDGE - EDGE.min(nodes - EDGE * brick)),
                    Err(false) => 0,
                };
                row[EDGE * brick / 64] |= bits << (EDGE * brick % 64);
            }
        }
    }

    /// From nodes to cells.
    fn mark(&mut self) {
        let (layout, inside) = (&self.layout, &self.inside);
        let boxes = self.marked.par_iter_mut().zip(layout.bricks()).with_min_len(64).map(|(marked, brick)| {
            *marked = cells(layout, inside, brick, 0);
            box_of(layout.grid(), brick, marked)
        });
        let range = around(boxes.reduce(|| NOTHING, around), self.of_others);
        let edge = self.layout.edge();
        for (index, (brick, marked)) in self.layout.bricks().iter().zip(&self.marked).enumerate() {
            let [x, y, z] = brick.at;
            let is_empty = marked.iter().fold(0, |all, bits| all | bits) == 0;
            self.blocks[(z * edge + y) * edge + x] = if is_empty { EMPTY } else { index as u32 };
        }
        self.range = if range[1] == [0; 3] { [[0; 3]; 2] } else { range };
    }
}

impl SurfaceCells for BrickOccupancy {
    type Values = BrickValues<1>;
    type Block = u32;

    fn grid(&self) -> &VoxelGrid {
        self.layout.grid()
    }

    fn range(&self) -> CellBox {
        self.range
    }

    #[inline]
    fn block(&self, [x, y, z]: [usize; 3]) -> Option<u32> {
        const { assert!(BLOCK == EDGE, "a block is a brick") };
        let edge = self.layout.edge();
        let block = self.blocks[(z * edge + y) * edge + x];
        (block != EMPTY).then_some(block)
    }

    #[inline]
    fn is_marked(&self, block: u32, [x, y, z]: [usize; 3]) -> bool {
        block == FULL || self.marked[block as usize][z % EDGE] >> (y % EDGE * EDGE + x % EDGE) & 1 == 1
    }

    #[inline]
    fn corners(&self, values: &Self::Values, cell: [usize; 3]) -> [f32; 8] {
        values.corners(cell).map(|[value]| value)
    }
}

impl BrickOccupancy {
    /// Ray depth, between `from` and `to`, at which the interpolated `values` (those the map was built of) first reach
    /// zero from below; as [`crate::OccupancyBitmask::first_crossing`].
    pub fn first_crossing(
        &self,
        values: &BrickValues<1>,
        origin: Vec3,
        direction: Vec3,
        from: f32,
        to: f32,
    ) -> Option<f32> {
        first_crossing(self, values, origin, direction, from, to)
    }
}

/// Bits of the values of a row that are not negative.
#[inline]
fn signs(row: &super::Row<1>) -> u64 {
    row.iter().enumerate().fold(0, |bits, (lane, [value])| bits | u64::from(*value >= 0.0) << lane)
}

/// The nodes of a brick that are not negative.
fn inside(layout: &BrickLayout, brick: &Brick, values: &BrickValues<1>) -> Bits {
    let [x, ..] = brick.at.map(|at| at * EDGE);
    // Rows end where the grid does.
    let there = 0xff >> (EDGE - EDGE.min(layout.grid().nodes() - x));
    std::array::from_fn(|z| {
        (0..EDGE).fold(0, |bits, y| {
            let row = match brick.row(y, z) {
                Some(slot) => signs(&values.rows()[slot]),
                None if brick.is_inside(y, z) => 0xff,
                None => 0,
            };
            bits | (row & there) << (y * EDGE)
        })
    })
}

/// The cells of a brick with a corner that is not negative; with one that is, where `flip` has all bits.
fn cells(layout: &BrickLayout, inside: &[Bits], brick: &Brick, flip: u64) -> Bits {
    let edge = layout.edge();
    let beside = |by: [usize; 3]| -> Bits {
        let at: [usize; 3] = std::array::from_fn(|axis| brick.at[axis] + by[axis]);
        if at.iter().any(|&at| at >= edge) {
            return [0; EDGE];
        }
        match layout.brick(at) {
            Ok(index) => inside[index].map(|bits| bits ^ flip),
            Err(true) => [!flip; EDGE],
            Err(false) => [flip; EDGE],
        }
    };
    // Of the brick and its neighbours along x and y: nodes of z and the one above.
    let above = |x: usize, y: usize| {
        let (low, high) = (beside([x, y, 0]), beside([x, y, 1])[0]);
        let next = |z: usize| if z + 1 < EDGE { low[z + 1] } else { high };
        std::array::from_fn::<u64, EDGE, _>(|z| low[z] | next(z))
    };
    let [own, along_x, along_y, along_both] = [above(0, 0), above(1, 0), above(0, 1), above(1, 1)];
    std::array::from_fn(|z| {
        let next_y = |own: u64, next: u64| own | own >> EDGE | next << (64 - EDGE);
        let (own, next) = (next_y(own[z], along_y[z]), next_y(along_x[z], along_both[z]));
        own | own >> 1 & LOWER | (next & LOWEST) << (EDGE - 1)
    })
}

/// The smallest box around the marked cells of a brick.
fn box_of(grid: &VoxelGrid, brick: &Brick, marked: &Bits) -> CellBox {
    let low = brick.at.map(|at| at * EDGE);
    let there = |at: usize| EDGE.min(grid.cells().saturating_sub(at));
    let mut all = 0u64;
    let (mut first_z, mut last_z) = (EDGE, 0);
    let rows = match there(low[1]) {
        0 => 0,
        rows => u64::MAX >> (64 - EDGE * rows),
    };
    for (z, word) in marked.iter().enumerate().take(there(low[2])) {
        if word & rows != 0 {
            all |= word & rows;
            first_z = first_z.min(z);
            last_z = z;
        }
    }
    if all == 0 {
        return NOTHING;
    }
    let columns = (0..EDGE).fold(0u8, |bits, y| bits | (all >> (y * EDGE)) as u8);
    let first = [columns.trailing_zeros() as usize, all.trailing_zeros() as usize / EDGE, first_z];
    let last = [7 - columns.leading_zeros() as usize, (63 - all.leading_zeros() as usize) / EDGE, last_z];
    let shifted = |by: [usize; 3], more: usize| std::array::from_fn(|axis| low[axis] + by[axis] + more);
    clipped(grid, [shifted(first, 0), shifted(last, 1)])
}

/// Without what lies beyond the grid; nothing where all of it does.
fn clipped(grid: &VoxelGrid, [low, high]: CellBox) -> CellBox {
    let is_beyond = low.iter().any(|&low| low >= grid.cells());
    if is_beyond { NOTHING } else { [low, high.map(|high| high.min(grid.cells()))] }
}

/// The smallest box around two.
fn around(a: CellBox, b: CellBox) -> CellBox {
    std::array::from_fn(|side| {
        std::array::from_fn(|axis| {
            let (a, b) = (a[side][axis], b[side][axis]);
            if side == 0 { a.min(b) } else { a.max(b) }
        })
    })
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::OccupancyBitmask;
    use crate::active::ActiveNodes;
    use crate::bricks::near_refined_surface;

    /// Marks, their box and crossings are those of the dense bitmask, bit for bit. Returns how many rays hit.
    fn compare(values: &BrickValues<1>, occupancy: &BrickOccupancy, rng: &mut ChaCha8Rng) -> usize {
        let (grid, dense) = (values.grid(), values.to_dense());
        let reference = OccupancyBitmask::new(grid, &dense);
        for cell in 0..grid.cells().pow(3) {
            let at = [cell % grid.cells(), cell / grid.cells() % grid.cells(), cell / grid.cells().pow(2)];
            let found = occupancy
                .block(at.map(|at| at / EDGE))
                .is_some_and(|block| SurfaceCells::is_marked(occupancy, block, at));
            assert_eq!(found, reference.is_marked(at), "{at:?}");
        }
        assert_eq!(occupancy.range(), SurfaceCells::range(&reference));
        let mut random = || Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        let mut hits = 0;
        for ray in 0..200 {
            let origin = random() * if ray % 4 == 0 { 0.5 } else { 2.0 };
            let direction = 0.4 * random() - origin;
            let found = occupancy.first_crossing(values, origin, direction, 0.0, f32::INFINITY);
            assert_eq!(found, reference.first_crossing(&dense, origin, direction, 0.0, f32::INFINITY));
            hits += usize::from(found.is_some());
        }
        hits
    }

    #[test]
    fn noise_in_all_bricks_is_marked_and_crossed_as_on_the_dense_grid() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut all = 0;
        // The last two are empty and full.
        for (nodes, offset) in [(5, 0.9), (9, 0.97), (20, 0.98), (41, 0.5), (33, 2.0), (33, -1.0)] {
            let grid = VoxelGrid::new(nodes, 0.55);
            let values: Vec<f32> = (0..grid.len()).map(|_| rng.random::<f32>() - offset).collect();
            let values = BrickValues::of_grid(&grid, &values);
            let hits = compare(&values, &BrickOccupancy::new(&values), &mut rng);
            assert!(offset < 1.0 || hits == 0, "{nodes} nodes, {offset}");
            all += hits;
        }
        assert!(all > 100, "{all} rays hit");
    }

    #[test]
    fn a_band_is_marked_and_crossed_as_on_the_dense_grid_wherever_the_surface_moves_in_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let (coarse, fine) = (VoxelGrid::new(25, 0.55), VoxelGrid::new(49, 0.55));
        let fields: [&dyn Fn(Vec3) -> f32; 3] = [
            &|at| 0.33 - (at - 0.07).length(),
            // Two sheets, and a ball that touches the border of the cube.
            &|at| 0.04 - (at.z - 0.1).abs().min((at.z + 0.2).abs()),
            &|at| 0.3 - (at - Vec3::new(0.3, 0.0, 0.0)).length(),
        ];
        for field in fields {
            let border = |node| coarse.coordinates(node).iter().any(|&c| c == 0 || c == 24);
            let value = |node| if border(node) { -0.02 } else { field(coarse.position(node)) };
            let learned: Vec<f32> = (0..coarse.len()).map(value).collect();
            let learned = Arc::new(BrickValues::of_grid(&coarse, &learned));
            let near = near_refined_surface(&fine, &learned, 3);
            let mut values = BrickValues::refined(&near, learned);
            assert!(values.layout().stored_rows() * EDGE < fine.len(), "a band, not all");
            let mut occupancy = BrickOccupancy::new(&values);
            assert!(compare(&values, &occupancy, &mut rng) > 20);
            // To the band's outer border, to its inner one, and to noise.
            for offset in [0.0, 1.0, 0.5] {
                write(&mut values, &near, || rng.random::<f32>() * 0.1 - 0.1 * offset);
                occupancy.update(&values);
                compare(&values, &occupancy, &mut rng);
            }
        }
    }

    fn write(values: &mut BrickValues<1>, active: &ActiveNodes, mut value: impl FnMut() -> f32) {
        let layout = values.layout().clone();
        layout.slots(active).for_each(|(slot, lane)| values.rows_mut()[slot][lane] = [value()]);
    }

    #[test]
    fn the_next_band_follows_a_surface_that_moved_across_the_whole_of_this_one() {
        let (coarse, fine, finest) = (VoxelGrid::new(17, 0.55), VoxelGrid::new(33, 0.55), VoxelGrid::new(65, 0.55));
        let ball: Vec<f32> = (0..coarse.len()).map(|node| 0.25 - coarse.position(node).length()).collect();
        let ball = Arc::new(BrickValues::of_grid(&coarse, &ball));
        let near = near_refined_surface(&fine, &ball, 3);
        for side in [1.0, -1.0] {
            let mut moved = BrickValues::refined(&near, ball.clone());
            write(&mut moved, &near, || 0.1 * side);
            let all = BrickValues::of_grid(&fine, &moved.to_dense());
            let (found, expected) = (near_refined_surface(&finest, &moved, 3), near_refined_surface(&finest, &all, 3));
            assert_eq!(found, expected);
            let (moved, all) = (Arc::new(moved), Arc::new(all));
            let (found, expected) = (BrickValues::refined(&found, moved), BrickValues::refined(&expected, all));
            assert_eq!(found.to_dense(), expected.to_dense());
            compare(&found, &BrickOccupancy::new(&found), &mut ChaCha8Rng::seed_from_u64(3));
        }
    }
}
