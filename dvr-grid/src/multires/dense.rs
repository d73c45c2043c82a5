//! The reference in tests: levels on dense grids, every node of them.

use dvr_core::voxel::VoxelGrid;
use pulp::NullaryFnOnce;

use super::adam::{Adam, AdamStep};
use crate::active::ActiveNodes;
use crate::constants::{BETA1, BETA2, EPSILON};

struct Level {
    active: ActiveNodes,
    parameters: Vec<f32>,
    moments: [Vec<f32>; 2],
    gradient: Vec<f32>,
    sum: Vec<f32>,
}

/// The counterpart of [`super::MultiResGrid`].
pub(super) struct Levels<const C: usize> {
    levels: Vec<Level>,
    base: Vec<f32>,
    pub values: Vec<f32>,
    steps: i32,
}

impl<const C: usize> Levels<C> {
    pub fn new(active: ActiveNodes, base: Vec<f32>, coarser: usize) -> Self {
        let mut sets = vec![active];
        (0..coarser).for_each(|_| sets.push(sets[sets.len() - 1].coarser()));
        let level = |active: ActiveNodes| {
            let zero = || vec![0.0; C * active.grid().len()];
            Level { parameters: zero(), moments: [zero(), zero()], gradient: zero(), sum: zero(), active }
        };
        Self { levels: sets.into_iter().rev().map(level).collect(), values: base.clone(), base, steps: 0 }
    }

    /// `gradient` is zero at nodes that are not active.
    pub fn step(&mut self, gradient: &[f32], rates: impl Fn(usize) -> f32) {
        let last = self.levels.len() - 1;
        self.levels[last].gradient = gradient.to_vec();
        for i in (1..=last).rev() {
            let fine = std::mem::take(&mut self.levels[i].gradient);
            let Level { active, gradient, .. } = &mut self.levels[i - 1];
            restrict::<C>(&fine, gradient, active);
            self.levels[i].gradient = fine;
        }
        self.steps += 1;
        self.descend(Some(rates));
    }

    /// The counterpart of [`super::MultiResGrid::refined`].
    pub fn refined(&self, active: ActiveNodes, base: Vec<f32>) -> Self {
        let mut refined = Self::new(active, base, self.levels.len());
        let finest = refined.levels.len() - 1;
        for i in (0..finest).rev() {
            let Level { active, parameters, moments, .. } = &self.levels[i];
            let level = &mut refined.levels[i];
            level.active = ActiveNodes::union(&level.active, active);
            (level.parameters, level.moments) = (parameters.clone(), moments.clone());
            if let Some(coarser) = i.checked_sub(1) {
                refined.levels[coarser].active = refined.levels[i].active.coarser();
            }
        }
        refined.steps = self.steps;
        refined.descend(None::<fn(usize) -> f32>);
        refined
    }

    fn descend(&mut self, rates: Option<impl Fn(usize) -> f32>) {
        let last = self.levels.len() - 1;
        for i in 0..=last {
            let (coarser, level) = self.levels.split_at_mut(i);
            let Level { active, parameters, moments: [first, second], gradient, sum } = &mut level[0];
            if let Some(rates) = &rates {
                let (beta1, beta2, epsilon) = (BETA1, BETA2, EPSILON);
                let settings = AdamStep { learning_rate: rates(i), beta1, beta2, epsilon, step: self.steps };
                Adam { parameters, gradient, first, second, settings: &settings }.call();
            }
            let target = if i == last { &mut self.values } else { sum };
            for node in active.iter() {
                for at in C * node..C * (node + 1) {
                    target[at] = if i == last { parameters[at] + self.base[at] } else { parameters[at] };
                }
            }
            if let Some(coarser) = coarser.last() {
                prolong_add::<C>(&coarser.sum, target, active);
            }
        }
    }
}

/// The trilinear interpolation of `coarse` at all nodes of a grid of twice the cells.
pub(super) fn prolonged<const C: usize>(coarse: &[f32], fine: &VoxelGrid) -> Vec<f32> {
    let mut prolonged = vec![0.0; C * fine.len()];
    prolong_add::<C>(coarse, &mut prolonged, &ActiveNodes::new(fine, |_| true));
    prolonged
}

/// Along one axis: the coarse nodes that a fine one lies between.
fn between(at: usize) -> [usize; 2] {
    [at / 2, at.div_ceil(2)]
}

/// Adds the trilinear interpolation of `coarse` at the active nodes.
fn prolong_add<const C: usize>(coarse: &[f32], fine: &mut [f32], active: &ActiveNodes) {
    let nodes = active.grid().nodes() / 2 + 1;
    for node in active.iter() {
        let [xs, ys, zs] = active.grid().coordinates(node).map(between);
        for c in 0..C {
            let at = |x: usize, y: usize, z: usize| coarse[((z * nodes + y) * nodes + x) * C + c];
            let blend =
                |x| 0.25 * (at(x, ys[0], zs[0]) + at(x, ys[1], zs[0]) + at(x, ys[0], zs[1]) + at(x, ys[1], zs[1]));
            fine[C * node + c] += 0.5 * (blend(xs[0]) + blend(xs[1]));
        }
    }
}

/// The transpose, at the active nodes of the coarse grid.
fn restrict<const C: usize>(fine: &[f32], coarse: &mut [f32], active: &ActiveNodes) {
    let nodes = 2 * active.grid().nodes() - 1;
    for node in active.iter() {
        let [x, y, z] = active.grid().coordinates(node);
        for c in 0..C {
            let column = |fine_x: Option<usize>| -> f32 {
                let Some(fine_x) = fine_x.filter(|&x| x < nodes) else { return 0.0 };
                let mut sum = 0.0;
                for (dz, weight_z) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
                    for (dy, weight_y) in [(0, 0.5), (1, 1.0), (2, 0.5)] {
                        let (y, z) = ((2 * y + dy).checked_sub(1), (2 * z + dz).checked_sub(1));
                        let (Some(y), Some(z)) = (y.filter(|&y| y < nodes), z.filter(|&z| z < nodes)) else { continue };
                        sum += weight_y * weight_z * fine[((z * nodes + y) * nodes + fine_x) * C + c];
                    }
                }
                sum
            };
            let sides = column((2 * x).checked_sub(1)) + column(Some(2 * x + 1));
            coarse[C * node + c] = column(Some(2 * x)) + 0.5 * sides;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(count: usize, factor: f32) -> Vec<f32> {
        (0..count).map(|i| (factor * i as f32).sin()).collect()
    }

    #[test]
    fn interpolation_is_trilinear_and_its_transpose_its_transpose() {
        let (coarse, fine) = (VoxelGrid::new(9, 0.55), VoxelGrid::new(17, 0.55));
        let (up, down) = (numbers(3 * coarse.len(), 0.7), numbers(3 * fine.len(), 1.3));
        let (prolonged, mut restricted) = (prolonged::<3>(&up, &fine), vec![0.0; up.len()]);
        restrict::<3>(&down, &mut restricted, &ActiveNodes::new(&coarse, |_| true));
        let green: Vec<f32> = up.iter().skip(1).step_by(3).copied().collect();
        for node in 0..fine.len() {
            assert!((prolonged[3 * node + 1] - coarse.value(&green, fine.position(node))).abs() < 1e-5);
        }
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(a * b)).sum::<f64>();
        let (left, right) = (dot(&prolonged, &down), dot(&up, &restricted));
        assert!((left - right).abs() < 1e-4 * left.abs().max(1.0), "{left} {right}");
    }
}
