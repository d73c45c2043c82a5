//! Between grids of which each has half the cells of the next: interpolation up, its transpose down.

use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::bricks::{Brick, BrickLayout, EDGE, Row};

/// Coarse nodes along the edge of a brick of the fine grid.
const AROUND: usize = EDGE / 2 + 1;

/// Numbers at the coarse nodes that those of a brick lie between, by z, y and x.
pub type Around<const C: usize> = [[[[f32; C]; AROUND]; AROUND]; AROUND];

/// Zeros.
pub fn nothing<const C: usize>() -> Around<C> {
    [[[[0.0; C]; AROUND]; AROUND]; AROUND]
}

/// Writes the coarse numbers around the nodes of a brick of the fine grid; zero where no row is stored.
#[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
#[inline(always)]
pub fn around<const C: usize>(coarse: &BrickLayout, numbers: &[Row<C>], brick: &Brick, around: &mut Around<C>) {
    let [x, y, z] = brick.at.map(|at| at * EDGE / 2);
    *around = nothing();
    for dz in 0..AROUND {
        for dy in 0..AROUND {
            let out = &mut around[dz][dy];
            if let Some(slot) = coarse.row(x / EDGE, y + dy, z + dz) {
                let from = &numbers[slot][x % EDGE..];
                let there = from.len().min(AROUND);
                out[..there].copy_from_slice(&from[..there]);
            }
            if x % EDGE > 0
                && let Some(slot) = coarse.row(x / EDGE + 1, y + dy, z + dz)
            {
                out[AROUND - 1] = numbers[slot][0];
            }
        }
    }
}

/// Trilinear interpolation at a row of a brick, given by its y and z in the brick.
#[inline(always)]
pub fn interpolated<const C: usize>(around: &Around<C>, y: usize, z: usize) -> Row<C> {
    let (ys, zs) = ([y / 2, y.div_ceil(2)], [z / 2, z.div_ceil(2)]);
    let rows = [&around[zs[0]][ys[0]], &around[zs[0]][ys[1]], &around[zs[1]][ys[0]], &around[zs[1]][ys[1]]];
    let mut blend = [[0.0; C]; AROUND];
    for (x, blend) in blend.iter_mut().enumerate() {
        for (c, blend) in blend.iter_mut().enumerate() {
            *blend = 0.25 * (rows[0][x][c] + rows[1][x][c] + rows[2][x][c] + rows[3][x][c]);
        }
    }
    let mut row = [[0.0; C]; EDGE];
    for (x, out) in row.iter_mut().enumerate() {
        for (c, out) in out.iter_mut().enumerate() {
            *out = 0.5 * (blend[x / 2][c] + blend[x.div_ceil(2)][c]);
        }
    }
    row
}

/// The transpose of interpolation: the gradient by the coarse nodes, of a gradient by the fine ones. Both are rows with
/// active nodes, zero at nodes that are not.
///
/// # Panics
/// When the coarse grid has not half the cells of the fine one, or there are not as many rows as the layouts have.
pub fn restrict<const C: usize>(fine: &BrickLayout, of: &[Row<C>], coarse: &BrickLayout, to: &mut [Row<C>]) {
    assert_eq!(fine.grid().cells(), 2 * coarse.grid().cells(), "the coarse grid must have half the cells");
    assert_eq!((of.len(), to.len()), (fine.active_rows(), coarse.active_rows()), "a row per row");
    let arch = Arch::new();
    let tasks: Vec<_> = coarse.tasks().zip(coarse.split(to)).collect();
    tasks.into_par_iter().for_each(|(bricks, to)| {
        arch.dispatch(Restrict { fine, of, coarse, bricks, to });
    });
}

/// [`restrict`] to some bricks.
struct Restrict<'a, const C: usize> {
    fine: &'a BrickLayout,
    of: &'a [Row<C>],
    coarse: &'a BrickLayout,
    bricks: &'a [Brick],
    to: &'a mut [Row<C>],
}

/// Compiled for each instruction set: a closure would not be.
impl<const C: usize> NullaryFnOnce for Restrict<'_, C> {
    type Output = ();

    #[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
    #[inline(always)]
    fn call(self) {
        let Self { fine, of, coarse, bricks, to } = self;
        let first = bricks[0].rows().start;
        for brick in bricks {
            let near = Near::of(fine, brick);
            for slot in brick.rows() {
                let [_, y, z] = coarse.place(brick, slot);
                let sum = near.sum(of, y % EDGE, z % EDGE);
                let (active, mut out) = (coarse.active_lanes(slot), [[0.0; C]; EDGE]);
                for lane in 0..EDGE {
                    for c in 0..C {
                        out[lane][c] = sum[lane][c] * active[lane];
                    }
                }
                to[slot - first] = out;
            }
        }
    }
}

/// The fine bricks in and before a coarse one, by z, y and x.
struct Near<'a>([[[Option<&'a Brick>; 3]; 3]; 3]);

impl<'a> Near<'a> {
    fn of(fine: &'a BrickLayout, coarse: &Brick) -> Self {
        let along = |axis: usize, by: usize| (2 * coarse.at[axis] + by).checked_sub(1).filter(|&at| at < fine.edge());
        let brick = |x: usize, y: usize, z: usize| {
            let index = fine.brick([along(0, x)?, along(1, y)?, along(2, z)?]).ok()?;
            Some(&fine.bricks()[index])
        };
        Self(std::array::from_fn(|z| std::array::from_fn(|y| std::array::from_fn(|x| brick(x, y, z)))))
    }

    /// The weighted sum for the row at `y` and `z` of the coarse brick: along y and z first.
    #[inline(always)]
    fn sum<const C: usize>(&self, of: &[Row<C>], y: usize, z: usize) -> Row<C> {
        // The last node of the brick before, and all of two bricks.
        let (mut before, mut low, mut high) = ([0.0; C], [[0.0; C]; EDGE], [[0.0; C]; EDGE]);
        for (dz, weight_z) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
            for (dy, weight_y) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
                let weight: f32 = weight_y * weight_z;
                let (y, z) = (EDGE + 2 * y + dy - 1, EDGE + 2 * z + dz - 1);
                let bricks = &self.0[z / EDGE][y / EDGE];
                if let Some(row) = row_of(of, bricks[0], y, z) {
                    add(&mut before, &row[EDGE - 1], weight);
                }
                if let Some(row) = row_of(of, bricks[1], y, z) {
                    add(low.as_flattened_mut(), row.as_flattened(), weight);
                }
                if let Some(row) = row_of(of, bricks[2], y, z) {
                    add(high.as_flattened_mut(), row.as_flattened(), weight);
                }
            }
        }
        let mut sum = [[0.0; C]; 2 * EDGE + 1];
        sum[0] = before;
        sum[1..=EDGE].copy_from_slice(&low);
        sum[EDGE + 1..].copy_from_slice(&high);
        let mut row = [[0.0; C]; EDGE];
        for (x, out) in row.iter_mut().enumerate() {
            for (c, out) in out.iter_mut().enumerate() {
                *out = sum[2 * x + 1][c] + 0.5 * (sum[2 * x][c] + sum[2 * x + 2][c]);
            }
        }
        row
    }
}

/// The row of a brick at `y` and `z`, where it has active nodes.
#[inline(always)]
fn row_of<'a, const C: usize>(of: &'a [Row<C>], brick: Option<&Brick>, y: usize, z: usize) -> Option<&'a Row<C>> {
    of.get(brick?.row(y % EDGE, z % EDGE)?)
}

#[inline(always)]
fn add(sum: &mut [f32], row: &[f32], weight: f32) {
    sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
}
