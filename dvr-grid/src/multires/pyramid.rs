//! Between grids of which each has half the cells of the next: interpolation up, its transpose down.

use glam::Vec4;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::bricks::{Brick, BrickLayout, EDGE, ROWS, Row};

/// Coarse nodes along the edge of a brick of the fine grid.
const AROUND: usize = EDGE / 2 + 1;

/// Numbers of half a row, `C` vectors of four.
type Half<const C: usize> = [Vec4; C];

/// Numbers at the coarse nodes that those of a brick of the fine grid lie between, by z and y: of each row along x, the first
/// four nodes, and the four after the first. To read the latter across the border of two vectors that were just written would
/// wait for both.
pub struct Around<const C: usize>([[[Half<C>; 2]; AROUND]; AROUND]);

impl<const C: usize> Around<C> {
    /// Zeros.
    pub fn nothing() -> Self {
        Self([[[[Vec4::ZERO; C]; 2]; AROUND]; AROUND])
    }

    /// Takes the numbers around a brick from rows with active nodes of the coarse grid; zero where no row is stored.
    #[inline(always)]
    pub fn take(&mut self, coarse: &BrickLayout, numbers: &[Row<C>], brick: &Brick) {
        let [x, y, z] = brick.at.map(|at| at % 2 * EDGE / 2);
        // The coarse brick that it lies in, and those after, at whose first nodes it may end.
        let bricks = coarse.slots_around::<2>(brick.at.map(|at| (at / 2) as isize));
        for (dz, plane) in self.0.iter_mut().enumerate() {
            for (dy, out) in plane.iter_mut().enumerate() {
                let (y, z) = (y + dy, z + dz);
                let (bricks, place) = (&bricks[z / EDGE][y / EDGE], z % EDGE * EDGE + y % EDGE);
                let row = row_at(numbers, bricks[0][place]);
                let mut nodes = [[0.0; C]; AROUND];
                if x == 0 {
                    nodes.copy_from_slice(&row[..AROUND]);
                } else {
                    nodes[..EDGE / 2].copy_from_slice(&row[EDGE / 2..]);
                    nodes[EDGE / 2] = row_at(numbers, bricks[1][place])[0];
                }
                let nodes = nodes.as_flattened();
                *out = [vectors(nodes), vectors(&nodes[C..])];
            }
        }
    }

    /// Trilinear interpolation at a row of the brick, given by its y and z in the brick.
    #[inline(always)]
    pub fn interpolated(&self, y: usize, z: usize) -> Row<C> {
        let [low, high] = [&self.0[z / 2], &self.0[z.div_ceil(2)]];
        let rows = [&low[y / 2], &low[y.div_ceil(2)], &high[y / 2], &high[y.div_ceil(2)]];
        let (mut at, mut between) = ([Vec4::ZERO; C], [Vec4::ZERO; C]);
        for i in 0..C {
            let blend =
                |half: usize| 0.25 * (rows[0][half][i] + rows[1][half][i] + rows[2][half][i] + rows[3][half][i]);
            at[i] = blend(0);
            between[i] = 0.5 * (at[i] + blend(1));
        }
        let mut row = [[0.0; C]; EDGE];
        for x in 0..EDGE / 2 {
            row[2 * x] = std::array::from_fn(|c| number(&at, C * x + c));
            row[2 * x + 1] = std::array::from_fn(|c| number(&between, C * x + c));
        }
        row
    }
}

/// The first `4 C` numbers in vectors.
#[inline(always)]
fn vectors<const C: usize>(numbers: &[f32]) -> Half<C> {
    let mut vectors = [Vec4::ZERO; C];
    for (i, vector) in vectors.iter_mut().enumerate() {
        *vector = Vec4::from_slice(&numbers[4 * i..]);
    }
    vectors
}

/// One of the numbers of vectors.
#[inline(always)]
fn number<const C: usize>(vectors: &Half<C>, index: usize) -> f32 {
    vectors[index / 4][index % 4]
}

/// The row with active nodes that a code of [`BrickLayout::slots_around`] means; zero where there is none.
#[inline(always)]
fn row_at<const C: usize>(rows: &[Row<C>], code: u32) -> &Row<C> {
    rows.get(code as usize).unwrap_or(const { &[[0.0; C]; EDGE] })
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

/// Codes of the rows of the fine bricks in and before a coarse one, by z, y and x.
struct Near<'a>([[[&'a [u32; ROWS]; 3]; 3]; 3]);

impl<'a> Near<'a> {
    fn of(fine: &'a BrickLayout, coarse: &Brick) -> Self {
        Self(fine.slots_around(coarse.at.map(|at| 2 * at as isize - 1)))
    }

    /// The weighted sum for the row at `y` and `z` of the coarse brick: along y and z first.
    #[inline(always)]
    fn sum<const C: usize>(&self, of: &[Row<C>], y: usize, z: usize) -> Row<C> {
        // The last node of the brick before, and all of two bricks.
        let (mut before, mut halves) = ([0.0; C], [[Vec4::ZERO; C]; 4]);
        for (dz, weight_z) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
            for (dy, weight_y) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
                let weight: f32 = weight_y * weight_z;
                let (y, z) = (EDGE + 2 * y + dy - 1, EDGE + 2 * z + dz - 1);
                let (bricks, place) = (&self.0[z / EDGE][y / EDGE], z % EDGE * EDGE + y % EDGE);
                let last = &row_at(of, bricks[0][place])[EDGE - 1];
                for c in 0..C {
                    before[c] += weight * last[c];
                }
                let [low, high] = [1, 2].map(|brick| row_at(of, bricks[brick][place]).as_flattened());
                add(&mut halves[0], low, weight);
                add(&mut halves[1], &low[4 * C..], weight);
                add(&mut halves[2], high, weight);
                add(&mut halves[3], &high[4 * C..], weight);
            }
        }
        let mut row = [[0.0; C]; EDGE];
        for (half, sums) in halves.iter().enumerate() {
            for c in 0..C {
                let of_node = |node: usize| number(sums, C * node + c);
                let before = if half == 0 { before[c] } else { number(&halves[half - 1], 3 * C + c) };
                row[2 * half][c] = of_node(0) + 0.5 * (before + of_node(1));
                row[2 * half + 1][c] = of_node(2) + 0.5 * (of_node(1) + of_node(3));
            }
        }
        row
    }
}

#[inline(always)]
fn add<const C: usize>(sum: &mut Half<C>, numbers: &[f32], weight: f32) {
    for (i, sum) in sum.iter_mut().enumerate() {
        *sum += weight * Vec4::from_slice(&numbers[4 * i..]);
    }
}
