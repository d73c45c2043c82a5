//! Laplacian smoothness: how far, in cells, a node near the surface is from the mean of its neighbours.
//!
//! `L = weight * mean_n H(l_n)`, with `l_n` the discrete Laplacian of the shape's values (the mean of a node's six
//! neighbours less itself) in spacings, and `H` the Huber function (Huber 1964): quadratic up to the knee and linear
//! beyond, so that noise is smoothed and edges stay. The mean is over the active nodes near the surface.

use std::ops::{Range, RangeInclusive};

use pulp::Arch;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::term::LossTerm;
use crate::active::ActiveNodes;

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

/// Measures smoothness at one set of active nodes; keeps its working space between steps.
#[derive(Clone, Debug, Default)]
pub(crate) struct LaplacianSmoothness {
    slopes: Vec<f32>,
}

impl LaplacianSmoothness {
    /// Adds the gradient of `weight` times the mean smoothness of the active nodes near the surface to `gradient`, at
    /// the active nodes, and returns that mean.
    ///
    /// # Panics
    /// When the slices are not as long as the grid, or an active node lies on its border.
    pub fn add_gradient(
        &mut self,
        values: &[f32],
        gradient: &mut [f32],
        active: &ActiveNodes,
        weight: f32,
        knee: f32,
    ) -> f32 {
        let grid = active.grid();
        let (nodes, plane, spacing) = (grid.nodes(), grid.nodes().pow(2), grid.spacing());
        assert_eq!((values.len(), gradient.len()), (grid.len(), grid.len()), "a value per node");
        // What is not active stays zero.
        self.slopes.resize(values.len(), 0.0);
        let arch = Arch::new();
        let limits = Limits { near: NEAR * spacing, knee, spacing };
        let sums: Vec<(f64, usize)> = self
            .slopes
            .par_chunks_mut(plane)
            .enumerate()
            .map(|(z, slopes)| {
                let (mut sum, mut count) = (0.0, 0);
                for &(start, length) in active.layer(z) {
                    let run = start as usize..(start + length) as usize;
                    let slopes = &mut slopes[run.start - z * plane..run.end - z * plane];
                    let found = arch.dispatch(|| measure(Around::new(values, run.clone(), nodes), slopes, &limits));
                    sum += found.0;
                    count += found.1;
                }
                (sum, count)
            })
            .collect();
        let (sum, count) = sums.iter().fold((0.0, 0), |(s, c), (sum, count)| (s + sum, c + count));
        if count == 0 {
            return 0.0;
        }
        let scale = weight / (count as f32 * spacing);
        let slopes = &self.slopes;
        gradient.par_chunks_mut(plane).enumerate().for_each(|(z, gradient)| {
            for &(start, length) in active.layer(z) {
                let run = start as usize..(start + length) as usize;
                let gradient = &mut gradient[run.start - z * plane..run.end - z * plane];
                arch.dispatch(|| spread(Around::new(slopes, run.clone(), nodes), gradient, scale));
            }
        });
        (sum / count as f64) as f32
    }
}

/// What counts, in units of the values.
struct Limits {
    near: f32,
    knee: f32,
    spacing: f32,
}

/// Numbers at a run of nodes and at their neighbours.
struct Around<'a> {
    own: &'a [f32],
    neighbours: [&'a [f32]; 6],
}

impl<'a> Around<'a> {
    /// For a run that is not on the border.
    #[inline(always)]
    fn new(values: &'a [f32], run: Range<usize>, nodes: usize) -> Self {
        let plane = nodes * nodes;
        let after = |distance: usize| &values[run.start + distance..run.end + distance];
        let before = |distance: usize| &values[run.start - distance..run.end - distance];
        let neighbours = [before(1), after(1), before(nodes), after(nodes), before(plane), after(plane)];
        Self { own: &values[run], neighbours }
    }

    /// Number of the run's node `i`, and how much larger the mean of its neighbours is.
    #[inline(always)]
    fn at(&self, i: usize) -> (f32, f32) {
        let sum = self.neighbours.iter().map(|values| values[i]).sum::<f32>();
        (self.own[i], sum / 6.0 - self.own[i])
    }
}

/// Slopes of the smoothness of a run's nodes; their sum of smoothness and the number of those near the surface.
#[inline(always)]
fn measure(values: Around, slopes: &mut [f32], limits: &Limits) -> (f64, usize) {
    let Limits { near, knee, spacing } = *limits;
    let (mut sum, mut count) = (0.0, 0);
    for (i, slope) in slopes.iter_mut().enumerate() {
        let (value, excess) = values.at(i);
        let laplacian = excess / spacing;
        let is_near = value.abs() <= near;
        *slope = if is_near { laplacian.clamp(-knee, knee) } else { 0.0 };
        // The Huber function by its slope: s^2 / 2 within the knee, and s beyond it for each further unit.
        sum += f64::from(*slope * (laplacian - 0.5 * *slope));
        count += usize::from(is_near);
    }
    (sum, count)
}

/// From slopes to the gradient by the values.
#[inline(always)]
fn spread(slopes: Around, gradient: &mut [f32], scale: f32) {
    for (i, gradient) in gradient.iter_mut().enumerate() {
        *gradient += scale * slopes.at(i).1;
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
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use dvr_core::voxel::VoxelGrid;

    #[test]
    fn the_gradient_is_that_of_differences() {
        let grid = VoxelGrid::new(8, 0.5);
        let inner = |node: usize| grid.coordinates(node).iter().all(|&c| c > 0 && c < 7);
        let active = ActiveNodes::new(&grid, |node| inner(node) && node % 11 != 0);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // Well within two spacings, so that differences do not move nodes over that border.
        let values: Vec<f32> = (0..grid.len()).map(|_| (rng.random::<f32>() - 0.5) * grid.spacing()).collect();
        let mean = |values: &[f32]| {
            let mut unused = vec![0.0; values.len()];
            LaplacianSmoothness::default().add_gradient(values, &mut unused, &active, 1.0, 0.2)
        };
        let mut gradient = vec![0.0; grid.len()];
        LaplacianSmoothness::default().add_gradient(&values, &mut gradient, &active, 1.0, 0.2);
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
    fn planes_are_smooth() {
        let grid = VoxelGrid::new(9, 0.5);
        let active = ActiveNodes::new(&grid, |node| grid.coordinates(node).iter().all(|&c| c > 0 && c < 8));
        let values: Vec<f32> = (0..grid.len()).map(|i| grid.position(i).dot(glam::Vec3::new(0.3, -0.5, 0.8))).collect();
        let mut gradient = vec![0.0; grid.len()];
        assert!(LaplacianSmoothness::default().add_gradient(&values, &mut gradient, &active, 1.0, 0.1) < 1e-8);
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
        let mut gradient = vec![0.0; values.len()];
        let found = LaplacianSmoothness::default().add_gradient(&values, &mut gradient, &active, 2.5, knee as f32);
        assert!((f64::from(found) - expected).abs() < 1e-5 * expected, "{found}, not {expected}");
        assert_eq!(SmoothnessLoss { weight: 2.5, knee }.weight(), 2.5);
    }
}
