//! Adam (Kingma and Ba 2015) on the active nodes of a grid.

use pulp::Arch;
use rayon::prelude::*;

use crate::active::ActiveNodes;

/// What a step needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamStep {
    /// Step size.
    pub learning_rate: f32,
    /// Decay of the gradient's running mean.
    pub beta1: f32,
    /// Decay of the running mean of its square.
    pub beta2: f32,
    /// Added to the root of the latter.
    pub epsilon: f32,
    /// Which step it is, from 1: corrects the bias of means that started at zero.
    pub step: i32,
}

/// The running means, one each per parameter.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// Of the gradient.
    pub first: Vec<f32>,
    /// Of its square.
    pub second: Vec<f32>,
}

impl Moments {
    /// Zeros for this many parameters.
    pub fn new(parameters: usize) -> Self {
        Self { first: vec![0.0; parameters], second: vec![0.0; parameters] }
    }
}

/// Moves the parameters of the active nodes; each node has `channels` of them, side by side. Parameters and moments are
/// those of the active nodes alone, in their order; the gradient is that of the whole grid.
///
/// # Panics
/// When there are not `channels` numbers per node.
pub fn step(
    parameters: &mut [f32],
    gradient: &[f32],
    moments: &mut Moments,
    active: &ActiveNodes,
    channels: usize,
    settings: &AdamStep,
) {
    let layer = active.grid().nodes().pow(2) * channels;
    assert_eq!(gradient.len(), active.grid().len() * channels, "{channels} values per node");
    let arch = Arch::new();
    (active.split_layers(channels, parameters), gradient.par_chunks(layer))
        .into_par_iter()
        .zip((active.split_layers(channels, &mut moments.first), active.split_layers(channels, &mut moments.second)))
        .enumerate()
        .for_each(|(z, ((parameters, gradient), (first, second)))| {
            let mut done = 0;
            for &(start, length) in active.layer(z) {
                let start = start as usize * channels - z * layer;
                let length = length as usize * channels;
                let own = done..done + length;
                arch.dispatch(|| {
                    run(
                        &mut parameters[own.clone()],
                        &gradient[start..start + length],
                        &mut first[own.clone()],
                        &mut second[own.clone()],
                        settings,
                    );
                });
                done += length;
            }
        });
}

/// One run; inlined into the dispatch, so that it is compiled for each instruction set.
#[inline(always)]
fn run(parameters: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32], settings: &AdamStep) {
    let AdamStep { learning_rate, beta1, beta2, epsilon, step } = *settings;
    let rate = learning_rate / (1.0 - beta1.powi(step));
    let scale = 1.0 / (1.0 - beta2.powi(step));
    for (((parameter, &g), m), v) in parameters.iter_mut().zip(gradient).zip(first).zip(second) {
        *m = beta1 * *m + (1.0 - beta1) * g;
        *v = beta2 * *v + (1.0 - beta2) * g * g;
        *parameter -= rate * *m / ((*v * scale).sqrt() + epsilon);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dvr_core::voxel::VoxelGrid;

    #[test]
    fn active_parameters_follow_adam() {
        let grid = VoxelGrid::new(5, 0.5);
        let active = ActiveNodes::new(&grid, |node| node % 4 != 1);
        let gradient: Vec<f32> = (0..3 * grid.len()).map(|i| (0.1 + i as f32 * 0.7).sin()).collect();
        let total = 3 * active.count();
        let (mut parameters, mut moments) = (vec![1.0f32; total], Moments::new(total));
        let at = |step| AdamStep { learning_rate: 0.1, beta1: 0.9, beta2: 0.99, epsilon: 1e-8, step };
        step(&mut parameters, &gradient, &mut moments, &active, 3, &at(1));
        step(&mut parameters, &gradient, &mut moments, &active, 3, &at(2));
        for (node, parameters) in active.iter().zip(parameters.chunks(3)) {
            for (c, parameter) in parameters.iter().enumerate() {
                // A constant gradient moves a parameter by the learning rate a step.
                let moved = 0.2 * gradient[3 * node + c].signum();
                assert!((1.0 - parameter - moved).abs() < 1e-5, "{node}: {parameter}");
            }
        }
    }
}
