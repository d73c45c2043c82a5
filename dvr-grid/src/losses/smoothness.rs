//! Laplacian smoothness: how far, in cells, a node near the surface is from the mean of its neighbours.
//!
//! `L = weight * mean_n H(l_n)`, with `l_n` the discrete Laplacian of the shape's values (the mean of a node's six
//! neighbours less itself) in spacings, and `H` the Huber function (Huber 1964): quadratic up to the knee and linear
//! beyond, so that noise is smoothed and edges stay. The mean is over the active nodes near the surface.

use std::ops::RangeInclusive;

use glam::Vec4;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::term::LossTerm;
use crate::bricks::{Brick, BrickLayout, BrickValues, EDGE, Row};

/// Nodes whose value is at most this many spacings from zero count as near the surface.
const NEAR: f32 = 2.0;

/// How far, in cells, a node near the surface is from the mean of its neighbours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SmoothnessLoss {
    /// Weight of the mean over nodes.
    pub weight: f64,
    /// Distances count in square up to this and linearly beyond: noise is smoothed, edges stay.
    pub knee: f64,
}

impl Default for SmoothnessLoss {
    fn default() -> Self {
        Self { weight: 3.0, knee: 0.05 }
    }
}

impl LossTerm for SmoothnessLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    fn parameters(&self) -> Vec<(&'static str, f64, RangeInclusive<f64>)> {
        vec![("knee", self.knee, 0.0..=f64::MAX)]
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        Self { weight: 1.0, knee: 0.2 }
    }
}

/// Measures smoothness at the active nodes of a grid; keeps its working space between steps.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaplacianSmoothness {
    /// Of the rows with active nodes, and one row of zeros.
    slopes: Vec<Row<1>>,
}

impl LaplacianSmoothness {
    /// Adds the gradient of `weight` times the mean smoothness of the active nodes near the surface to `gradient`, of the
    /// rows with active nodes, and returns that mean. No active node lies on the grid's border.
    ///
    /// # Panics
    /// When there are not as many rows as there are with active nodes.
    pub fn add_gradient(&mut self, values: &BrickValues<1>, gradient: &mut [Row<1>], weight: f32, knee: f32) -> f32 {
        let (layout, spacing) = (values.layout(), values.grid().spacing());
        assert_eq!(gradient.len(), layout.active_rows(), "a row per row with active nodes");
        self.slopes.resize(layout.active_rows() + 1, [[0.0]; EDGE]);
        self.slopes[layout.active_rows()] = [[0.0]; EDGE];
        let arch = Arch::new();
        let limits = Limits { near: NEAR * spacing, knee, spacing };
        let tasks: Vec<_> = layout.tasks().zip(layout.split(&mut self.slopes)).collect();
        let sums: Vec<(f64, u32)> = tasks
            .into_par_iter()
            .map(|(bricks, slopes)| arch.dispatch(Measure { bricks, values, slopes, limits: &limits }))
            .collect();
        let (sum, count) = sums.iter().fold((0.0, 0), |(s, c), (sum, count)| (s + sum, c + count));
        if count == 0 {
            return 0.0;
        }
        let scale = weight / (count as f32 * spacing);
        let slopes = &self.slopes;
        let tasks: Vec<_> = layout.tasks().zip(layout.split(gradient)).collect();
        tasks.into_par_iter().for_each(|(bricks, gradient)| {
            arch.dispatch(Spread { bricks, layout, slopes, gradient, scale });
        });
        (sum / f64::from(count)) as f32
    }
}

/// What counts, in units of the values.
struct Limits {
    near: f32,
    knee: f32,
    spacing: f32,
}

/// A number of each node of a row, in vectors: loops over the eight are compiled to numbers one by one.
type Halves = [Vec4; 2];

#[inline(always)]
fn halves(row: &Row<1>) -> Halves {
    [four(row, 0), four(row, 4)]
}

/// Four numbers of a row side by side.
#[inline(always)]
fn four(row: &Row<1>, first: usize) -> Vec4 {
    Vec4::new(row[first][0], row[first + 1][0], row[first + 2][0], row[first + 3][0])
}

/// How much larger the means of the neighbours of a row's nodes are; `neighbours` are the rows along x, y and z, and
/// those beyond the last one are the last one.
#[inline(always)]
fn excess(rows: &[Row<1>], slot: usize, neighbours: &[u32; 6]) -> Halves {
    let last = rows.len() - 1;
    let row = |index: usize| &rows[last.min(neighbours[index] as usize)];
    let own = &rows[slot];
    let ([before], [behind]) = (row(0)[EDGE - 1], row(1)[0]);
    let low = Vec4::new(before, own[0][0], own[1][0], own[2][0]) + four(own, 1);
    let high = four(own, 3) + Vec4::new(own[5][0], own[6][0], own[7][0], behind);
    let (a, b, c, d, own) = (halves(row(2)), halves(row(3)), halves(row(4)), halves(row(5)), halves(own));
    [(low + a[0] + b[0] + c[0] + d[0]) / 6.0 - own[0], (high + a[1] + b[1] + c[1] + d[1]) / 6.0 - own[1]]
}

/// Slopes of the smoothness of active nodes, zero at others; returns the sum of their smoothness and the number of those
/// near the surface.
struct Measure<'a> {
    bricks: &'a [Brick],
    values: &'a BrickValues<1>,
    slopes: &'a mut [Row<1>],
    limits: &'a Limits,
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Measure<'_> {
    type Output = (f64, u32);

    #[inline(always)]
    fn call(self) -> (f64, u32) {
        let Self { bricks, values, slopes, limits } = self;
        let (layout, rows) = (values.layout(), values.rows());
        let Limits { near: reach, knee, spacing } = *limits;
        let knee = Vec4::splat(knee);
        let (mut sum, mut counts) = (0.0, [Vec4::ZERO; 2]);
        let first = bricks[0].rows().start;
        for brick in bricks {
            // Few enough for single precision.
            let mut of_brick = [Vec4::ZERO; 2];
            for slot in brick.rows() {
                let laplacian = excess(rows, slot, layout.neighbours(slot));
                let active = layout.active_lanes(slot).as_chunks().0;
                let (own, slopes) = (halves(&rows[slot]), slopes[slot - first].as_flattened_mut());
                for half in 0..2 {
                    let laplacian = laplacian[half] / spacing;
                    let is_near = own[half].abs().cmple(Vec4::splat(reach));
                    let near = Vec4::select(is_near, Vec4::from_array(active[half]), Vec4::ZERO);
                    let slope = near * laplacian.max(-knee).min(knee);
                    // The Huber function by its slope: s^2 / 2 within the knee, and s beyond it for each further unit.
                    of_brick[half] += slope * (laplacian - 0.5 * slope);
                    slope.write_to_slice(&mut slopes[4 * half..]);
                    counts[half] += near;
                }
            }
            sum += f64::from((of_brick[0] + of_brick[1]).element_sum());
        }
        let count = (counts[0] + counts[1]).element_sum();
        (sum, count as u32)
    }
}

/// From slopes to the gradient by the values of active nodes.
struct Spread<'a> {
    bricks: &'a [Brick],
    layout: &'a BrickLayout,
    slopes: &'a [Row<1>],
    gradient: &'a mut [Row<1>],
    scale: f32,
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Spread<'_> {
    type Output = ();

    #[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
    #[inline(always)]
    fn call(self) {
        let Self { bricks, layout, slopes, gradient, scale } = self;
        let first = bricks[0].rows().start;
        for (slot, gradient) in (first..).zip(gradient) {
            let excess = excess(slopes, slot, layout.neighbours(slot));
            let active = layout.active_lanes(slot).as_chunks().0;
            for (half, gradient) in gradient.as_flattened_mut().as_chunks_mut().0.iter_mut().enumerate() {
                *gradient =
                    (Vec4::from_array(*gradient) + scale * excess[half] * Vec4::from_array(active[half])).to_array();
            }
        }
    }
}

/// The same inside kernels; the kernels themselves are in `step::gpu::smoothness`.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::NEAR;
    use crate::gpu::launch::NONE;

    /// What a node adds to the mean.
    #[derive(CubeType)]
    pub(crate) struct NodeSmoothness {
        pub value: f32,
        /// Derivative of the value by the Laplacian.
        pub slope: f32,
        pub is_near: bool,
    }

    /// How much larger the mean of a node's six neighbours is.
    #[cube]
    fn excess(values: &[f32], node: usize, nodes: usize) -> f32 {
        let plane = nodes * nodes;
        let sum = values[node - 1]
            + values[node + 1]
            + values[node - nodes]
            + values[node + nodes]
            + values[node - plane]
            + values[node + plane];
        sum / 6.0f32 - values[node]
    }

    #[cube]
    pub(crate) fn measure(values: &[f32], node: usize, nodes: usize, spacing: f32, knee: f32) -> NodeSmoothness {
        let laplacian = excess(values, node, nodes) / spacing;
        let is_near = values[node].abs() <= NEAR * spacing;
        let slope = select(is_near, laplacian.max(-knee).min(knee), 0.0f32);
        // The Huber function by its slope: s^2 / 2 within the knee, and s beyond it for each further unit.
        NodeSmoothness { value: slope * (laplacian - 0.5f32 * slope), slope, is_near }
    }

    /// A neighbour's slope; zero where it is not active.
    #[cube]
    fn slope_at(slots: &[u32], slopes: &[f32], node: usize) -> f32 {
        let slot = slots[node];
        let mut slope = 0.0f32;
        if slot != NONE {
            slope = slopes[slot as usize];
        }
        slope
    }

    /// The gradient of the sum over nodes by a node's value, in spacings.
    #[cube]
    pub(crate) fn spread(slots: &[u32], slopes: &[f32], slot: usize, node: usize, nodes: usize) -> f32 {
        let plane = nodes * nodes;
        let sum = slope_at(slots, slopes, node - 1)
            + slope_at(slots, slopes, node + 1)
            + slope_at(slots, slopes, node - nodes)
            + slope_at(slots, slopes, node + nodes)
            + slope_at(slots, slopes, node - plane)
            + slope_at(slots, slopes, node + plane);
        sum / 6.0f32 - slopes[slot]
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::active::ActiveNodes;
    use crate::bricks::near_refined_surface;
    use dvr_core::voxel::VoxelGrid;

    /// The mean smoothness of values of a grid at active nodes, and its gradient at all nodes.
    fn smoothness(active: &ActiveNodes, values: &[f32], weight: f32, knee: f32) -> (f32, Vec<f32>) {
        let values = BrickValues::<1>::dense(active, values);
        let mut rows = vec![[[0.0]; EDGE]; values.layout().active_rows()];
        let mean = LaplacianSmoothness::default().add_gradient(&values, &mut rows, weight, knee);
        let mut gradient = vec![0.0; active.grid().len()];
        for (node, found) in active.iter().zip(values.layout().of_rows(active, &rows)) {
            gradient[node] = found;
        }
        (mean, gradient)
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        let grid = VoxelGrid::new(8, 0.5);
        let inner = |node: usize| grid.coordinates(node).iter().all(|&c| c > 0 && c < 7);
        let active = ActiveNodes::new(&grid, |node| inner(node) && node % 11 != 0);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // Well within two spacings, so that differences do not move nodes over that border.
        let values: Vec<f32> = (0..grid.len()).map(|_| (rng.random::<f32>() - 0.5) * grid.spacing()).collect();
        let mean = |values: &[f32]| smoothness(&active, values, 1.0, 0.2).0;
        let (_, gradient) = smoothness(&active, &values, 1.0, 0.2);
        for node in active.iter().step_by(7) {
            let at = |step: f32| {
                let mut moved = values.clone();
                moved[node] += step;
                mean(&moved)
            };
            let step = 1e-2 * grid.spacing();
            let difference = (at(step) - at(-step)) / (2.0 * step);
            assert!(
                (difference - gradient[node]).abs() < 2e-3 * (1.0 + difference.abs()),
                "{node}: {difference} {}",
                gradient[node]
            );
        }
    }

    #[test]
    fn in_a_band_it_is_that_of_all_nodes_stored() {
        let (coarse, fine) = (VoxelGrid::new(33, 0.55), VoxelGrid::new(65, 0.55));
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        // The second ball leaves the cube through its border.
        for middle in [0.05, 0.4] {
            let distance = |node| 0.3 - (coarse.position(node) - glam::Vec3::new(middle, 0.02, 0.0)).length();
            let learned: Vec<f32> = (0..coarse.len()).map(|node| distance(node) + 0.01 * rng.random::<f32>()).collect();
            let learned = Arc::new(BrickValues::of_grid(&coarse, &learned));
            let active = near_refined_surface(&fine, &learned, 3);
            let band = BrickValues::<1>::refined(&active, learned);
            assert!(2 * EDGE * band.layout().stored_rows() < fine.len());
            let mut rows = vec![[[0.0]; EDGE]; band.layout().active_rows()];
            let mean = LaplacianSmoothness::default().add_gradient(&band, &mut rows, 1.0, 0.05);
            let (expected_mean, expected) = smoothness(&active, &band.to_dense(), 1.0, 0.05);
            assert!(mean > 0.0 && (mean - expected_mean).abs() < 1e-6 * mean, "{mean} {expected_mean}");
            let found = band.layout().of_rows(&active, &rows);
            assert!(active.iter().zip(found).all(|(node, found)| found == expected[node]), "bit for bit");
        }
    }

    #[test]
    fn planes_are_smooth() {
        let grid = VoxelGrid::new(9, 0.5);
        let active = ActiveNodes::new(&grid, |node| grid.coordinates(node).iter().all(|&c| c > 0 && c < 8));
        let values: Vec<f32> = (0..grid.len()).map(|i| grid.position(i).dot(glam::Vec3::new(0.3, -0.5, 0.8))).collect();
        assert!(smoothness(&active, &values, 1.0, 0.1).0 < 1e-8);
    }

    #[test]
    fn it_is_the_mean_of_the_hubers_of_laplacians_of_nodes_near_the_surface() {
        let grid = VoxelGrid::new(8, 0.5);
        let (spacing, knee) = (f64::from(grid.spacing()), 0.3);
        let active = ActiveNodes::new(&grid, |node| grid.coordinates(node).iter().all(|&c| c > 0 && c < 7));
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let values: Vec<f32> = (0..grid.len()).map(|_| 6.0 * (rng.random::<f32>() - 0.5) * grid.spacing()).collect();
        let is_near = |node: &usize| f64::from(values[*node].abs()) <= f64::from(NEAR) * spacing;
        let laplacian = |node: usize| {
            let around = [node - 1, node + 1, node - 8, node + 8, node - 64, node + 64];
            let mean = around.iter().map(|&other| f64::from(values[other])).sum::<f64>() / 6.0;
            (mean - f64::from(values[node])) / spacing
        };
        let huber = |x: f64| if x.abs() <= knee { 0.5 * x * x } else { knee * (x.abs() - 0.5 * knee) };
        let near: Vec<f64> = active.iter().filter(is_near).map(laplacian).collect();
        let beyond = near.iter().filter(|x| x.abs() > knee).count();
        assert!(near.len() < active.count() && beyond > 10 && beyond + 10 < near.len(), "{beyond} of {}", near.len());
        let expected = near.iter().map(|&x| huber(x)).sum::<f64>() / near.len() as f64;
        let (found, _) = smoothness(&active, &values, 2.5, knee as f32);
        assert!((f64::from(found) - expected).abs() < 1e-5 * expected, "{found}, not {expected}");
        assert_eq!(SmoothnessLoss { weight: 2.5, knee }.weight(), 2.5);
    }
}
