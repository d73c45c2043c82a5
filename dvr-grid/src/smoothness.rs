//! How rough a grid's values are near their zero set, and the gradient of that.

use std::ops::Range;

use pulp::Arch;
use rayon::prelude::*;

use crate::active::ActiveNodes;
use crate::constants::NEAR;

/// Measures smoothness at one set of active nodes; keeps its working space between steps.
#[derive(Clone, Debug, Default)]
pub struct LaplacianSmoothness {
    slopes: Vec<f32>,
}

impl LaplacianSmoothness {
    /// Adds the gradient of `weight` times the mean smoothness of the active nodes near the surface to `gradient`, at
    /// the active nodes, and returns that mean.
    ///
    /// A node's smoothness is the Huber function (Huber 1964) of the discrete Laplacian, the mean of its six neighbours
    /// less itself, in spacings: quadratic up to `knee` and linear beyond, so that noise is smoothed and edges stay.
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
        assert_eq!((values.len(), gradient.len()), (grid.len(), grid.len()), "a value a node");
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
}
