//! How rough a lattice's values are near their zero set, and the gradient of that.

use rayon::prelude::*;

use crate::active::ActiveNodes;

/// Nodes whose value is at most so many spacings from zero count as near the surface.
const NEAR: f32 = 2.0;

/// Measures roughness; keeps its working space between steps.
#[derive(Clone, Debug, Default)]
pub struct Roughness {
    slopes: Vec<f32>,
}

impl Roughness {
    /// Adds the gradient of `weight` times the mean roughness of the active nodes near the surface to `gradient`, at the
    /// active nodes, and returns that mean.
    ///
    /// A node's roughness is the Huber function (Huber 1964) of the discrete Laplacian, the mean of its six neighbours
    /// less itself, in spacings: quadratic up to `knee` and linear beyond, so that noise is smoothed and edges stay.
    ///
    /// # Panics
    /// When the slices are not as long as the lattice, or an active node lies on its border.
    pub fn add_gradient(
        &mut self,
        values: &[f32],
        gradient: &mut [f32],
        active: &ActiveNodes,
        weight: f32,
        knee: f32,
    ) -> f32 {
        let lattice = active.lattice();
        let (nodes, plane, spacing) = (lattice.nodes(), lattice.nodes().pow(2), lattice.spacing());
        assert_eq!((values.len(), gradient.len()), (lattice.len(), lattice.len()), "a value a node");
        self.slopes.clear();
        self.slopes.resize(values.len(), 0.0);
        let near = NEAR * spacing;
        let sums: Vec<(f64, usize)> = self
            .slopes
            .par_chunks_mut(plane)
            .enumerate()
            .map(|(z, slopes)| {
                let (mut sum, mut count) = (0.0f64, 0);
                for &(start, length) in active.layer(z) {
                    for node in start as usize..(start + length) as usize {
                        let value = values[node];
                        if value.abs() > near {
                            continue;
                        }
                        let around = neighbour_sum(values, node, nodes);
                        let laplacian = (around / 6.0 - value) / spacing;
                        slopes[node - z * plane] = laplacian.clamp(-knee, knee);
                        let size = laplacian.abs();
                        let huber = if size <= knee { 0.5 * size * size } else { knee * (size - 0.5 * knee) };
                        sum += f64::from(huber);
                        count += 1;
                    }
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
                for node in start as usize..(start + length) as usize {
                    let around = neighbour_sum(slopes, node, nodes);
                    gradient[node - z * plane] += scale * (around / 6.0 - slopes[node]);
                }
            }
        });
        (sum / count as f64) as f32
    }
}

/// Sum over the six neighbours of a node that is not on the border.
#[inline]
fn neighbour_sum(values: &[f32], node: usize, nodes: usize) -> f32 {
    let plane = nodes * nodes;
    values[node - 1]
        + values[node + 1]
        + values[node - nodes]
        + values[node + nodes]
        + values[node - plane]
        + values[node + plane]
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::lattice::Lattice;

    #[test]
    fn the_gradient_is_that_of_differences() {
        let lattice = Lattice::new(8, 0.5);
        let inner = |node: usize| lattice.coordinates(node).iter().all(|&c| c > 0 && c < 7);
        let active = ActiveNodes::new(&lattice, |node| inner(node) && node % 11 != 0);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // Well within two spacings, so that differences do not move nodes over that border.
        let values: Vec<f32> = (0..lattice.len()).map(|_| (rng.random::<f32>() - 0.5) * lattice.spacing()).collect();
        let mean = |values: &[f32]| {
            let mut unused = vec![0.0; values.len()];
            Roughness::default().add_gradient(values, &mut unused, &active, 1.0, 0.2)
        };
        let mut gradient = vec![0.0; lattice.len()];
        Roughness::default().add_gradient(&values, &mut gradient, &active, 1.0, 0.2);
        for node in active.iter().step_by(7) {
            let at = |step: f32| {
                let mut moved = values.clone();
                moved[node] += step;
                mean(&moved)
            };
            let step = 1e-2 * lattice.spacing();
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
        let lattice = Lattice::new(9, 0.5);
        let active = ActiveNodes::new(&lattice, |node| lattice.coordinates(node).iter().all(|&c| c > 0 && c < 8));
        let values: Vec<f32> =
            (0..lattice.len()).map(|i| lattice.position(i).dot(glam::Vec3::new(0.3, -0.5, 0.8))).collect();
        let mut gradient = vec![0.0; lattice.len()];
        assert!(Roughness::default().add_gradient(&values, &mut gradient, &active, 1.0, 0.1) < 1e-8);
    }
}
