//! Parameters on nested grids, from coarse to fine, whose sum is one fine grid.

use super::adam::{self, AdamStep, Moments};
use super::pyramid;
use crate::active::ActiveNodes;
use crate::constants;
use dvr_core::voxel::VoxelGrid;
use rayon::prelude::*;

/// The parameters of one grid.
#[derive(Clone, Debug)]
struct Level {
    active: ActiveNodes,
    /// Of the active nodes alone, as the moments are.
    parameters: Vec<f32>,
    moments: Moments,
    /// Of all nodes of the grid.
    gradient: Vec<f32>,
    /// Sum of this level and the coarser ones, at all nodes; empty at the finest, whose sum is the grid's values.
    sum: Vec<f32>,
}

/// Nested grids of `C` channels per node. A coarse node moves all fine ones around it: gradients reach far at once,
/// and the fine levels add the detail. The sum is kept as values at the finest nodes, the only ones that are ever
/// sampled.
#[derive(Clone, Debug)]
pub(crate) struct MultiResGrid<const C: usize> {
    /// Coarse to fine; at least one.
    levels: Vec<Level>,
    /// What is added to the sum of the levels, at the finest nodes.
    base: Vec<f32>,
    /// Whether the base is what earlier stages learned; see [`MultiResGrid::on_frozen_base`].
    has_frozen_base: bool,
    values: Vec<f32>,
    steps: i32,
}

impl<const C: usize> MultiResGrid<C> {
    /// Zero parameters on top of `base`, at the active nodes of the finest grid and `coarser` coarser ones.
    pub fn new(active: ActiveNodes, base: Vec<f32>, coarser: usize) -> Self {
        let mut levels = vec![Level::new(active, C)];
        for _ in 0..coarser {
            let next = levels[levels.len() - 1].active.coarser();
            levels.push(Level::new(next, C));
        }
        levels.reverse();
        Self { values: base.clone(), levels, base, has_frozen_base: false, steps: 0 }
    }

    /// The finest grid.
    pub fn grid(&self) -> &VoxelGrid {
        self.active().grid()
    }

    /// The active nodes of the finest grid.
    pub fn active(&self) -> &ActiveNodes {
        &self.finest().active
    }

    /// The active nodes of all levels, coarse to fine.
    #[cfg(feature = "gpu")]
    pub fn node_sets(&self) -> impl Iterator<Item = &ActiveNodes> {
        self.levels.iter().map(|level| &level.active)
    }

    /// What is added to the sum of the levels, at the finest nodes.
    #[cfg(feature = "gpu")]
    pub fn base(&self) -> &[f32] {
        &self.base
    }

    /// The values at the finest nodes, all levels and the base summed.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The values at the finest nodes, the gradient by them, to be written before [`MultiResGrid::step`], and the nodes at
    /// which it counts.
    pub fn values_and_gradient_mut(&mut self) -> (&[f32], &mut [f32], &ActiveNodes) {
        let last = self.levels.len() - 1;
        let Level { gradient, active, .. } = &mut self.levels[last];
        (&self.values, gradient, active)
    }

    /// Adds the gradient of half `weight` times the squared distance to `rest` at every active node. However small, it
    /// moves what nothing else does: Adam's steps do not depend on a gradient's size.
    pub fn pull_towards(&mut self, rest: [f32; C], weight: f32) {
        let (values, gradient, active) = self.values_and_gradient_mut();
        let layer = C * active.grid().nodes().pow(2);
        gradient.par_chunks_mut(layer).enumerate().for_each(|(z, gradient)| {
            for &(start, length) in active.layer(z) {
                for i in C * start as usize..C * (start + length) as usize {
                    gradient[i - z * layer] += weight * (values[i] - rest[i % C]);
                }
            }
        });
    }

    /// Levels besides the finest.
    pub fn coarser(&self) -> usize {
        self.levels.len() - 1
    }

    /// Parameters of all levels.
    pub fn parameters(&self) -> usize {
        self.levels.iter().map(|level| C * level.active.count()).sum()
    }

    /// The same sum on a grid of twice the cells, with a new base there and one more level.
    pub fn refined(&self, active: ActiveNodes, base: Vec<f32>) -> Self {
        let mut levels: Vec<Level> = Vec::new();
        let mut coarser = active.coarser();
        for level in self.levels.iter().rev() {
            // A node that becomes active was zero so far; one that no longer is keeps what it has.
            let active = ActiveNodes::union(&coarser, &level.active);
            if levels.len() + 1 < self.levels.len() {
                coarser = active.coarser();
            }
            levels.push(level.carried(C, active));
        }
        levels.reverse();
        levels.push(Level::new(active, C));
        let mut refined = Self { values: base.clone(), levels, base, has_frozen_base: false, steps: self.steps };
        refined.sum_levels();
        refined
    }

    /// Zero parameters at the active nodes and in `coarser` levels, on top of a base that holds at every second node
    /// what earlier stages learned: where nothing is left to learn, nothing is stored and nothing is computed.
    pub fn on_frozen_base(active: ActiveNodes, base: Vec<f32>, coarser: usize) -> Self {
        Self { has_frozen_base: true, ..Self::new(active, base, coarser) }
    }

    /// What earlier stages learned, on the grid of half the cells, of levels on a frozen base.
    pub fn learned(&self) -> Option<Vec<f32>> {
        let (fine, coarse) = (self.grid(), halved(self.grid()));
        let of_node = |node: usize| {
            let node = fine.index(coarse.coordinates(node).map(|c| 2 * c));
            &self.base[C * node..C * (node + 1)]
        };
        self.has_frozen_base.then(|| (0..coarse.len()).flat_map(of_node).copied().collect())
    }

    /// One step of Adam against the gradient, then the sum again. `rates` gives the step size of each level, coarse to
    /// fine.
    pub fn step(&mut self, rates: impl Fn(usize) -> f32) {
        for i in (1..self.levels.len()).rev() {
            let (coarse, fine) = self.levels.split_at_mut(i);
            let coarse = &mut coarse[i - 1];
            pyramid::restrict::<C>(&fine[0].gradient, &mut coarse.gradient, &coarse.active);
        }
        self.steps += 1;
        for (i, level) in self.levels.iter_mut().enumerate() {
            let (beta1, beta2, epsilon) = (constants::BETA1, constants::BETA2, constants::EPSILON);
            let settings = AdamStep { learning_rate: rates(i), beta1, beta2, epsilon, step: self.steps };
            let Level { active, parameters, gradient, moments, .. } = level;
            adam::step(parameters, gradient, moments, active, C, &settings);
        }
        self.sum_levels();
    }

    /// Steps done, and parameters and moments at the active nodes, in one row.
    pub fn state(&self) -> Vec<f32> {
        let mut state = vec![self.steps as f32];
        for level in &self.levels {
            for values in [&level.parameters, &level.moments.first, &level.moments.second] {
                state.extend_from_slice(values);
            }
        }
        state
    }

    /// Takes up what [`MultiResGrid::state`] gave for levels with the same nodes; `false` where it does not fit.
    pub fn restore(&mut self, state: &[f32]) -> bool {
        if state.len() != 1 + 3 * self.parameters() {
            return false;
        }
        self.steps = state[0] as i32;
        let mut rest = &state[1..];
        for level in &mut self.levels {
            let Level { parameters, moments, .. } = level;
            for values in [parameters, &mut moments.first, &mut moments.second] {
                let (own, others) = rest.split_at(values.len());
                values.copy_from_slice(own);
                rest = others;
            }
        }
        self.sum_levels();
        true
    }

    fn finest(&self) -> &Level {
        &self.levels[self.levels.len() - 1]
    }

    /// Sums base and levels.
    fn sum_levels(&mut self) {
        let last = self.levels.len() - 1;
        for i in 0..=last {
            let (coarse, fine) = self.levels.split_at_mut(i);
            let Level { active, parameters, sum, .. } = &mut fine[0];
            let (target, base) = if i == last { (&mut self.values, Some(&self.base)) } else { (&mut *sum, None) };
            target.resize(C * active.grid().len(), 0.0);
            sum_active::<C>(target, parameters, base, active);
            if let Some(coarse) = coarse.last() {
                pyramid::prolong_add::<C>(&coarse.sum, target, active);
            }
        }
    }
}

impl Level {
    fn new(active: ActiveNodes, channels: usize) -> Self {
        let (stored, total) = (channels * active.count(), channels * active.grid().len());
        Self {
            active,
            parameters: vec![0.0; stored],
            moments: Moments::new(stored),
            gradient: vec![0.0; total],
            sum: Vec::new(),
        }
    }

    /// The same with other active nodes: parameters of new ones are zero.
    fn carried(&self, channels: usize, active: ActiveNodes) -> Self {
        let carried = |values: &[f32]| self.active.carried(channels, values, &active);
        let parameters = carried(&self.parameters);
        let moments = Moments { first: carried(&self.moments.first), second: carried(&self.moments.second) };
        Self { parameters, moments, ..Self::new(active, channels) }
    }
}

/// The grid with half the cells.
fn halved(grid: &VoxelGrid) -> VoxelGrid {
    VoxelGrid::new(grid.cells() / 2 + 1, grid.half_extent())
}

/// Values on a grid, interpolated on one of twice the cells.
pub(crate) fn prolonged<const C: usize>(values: &[f32], fine: &VoxelGrid) -> Vec<f32> {
    let mut prolonged = vec![0.0; C * fine.len()];
    pyramid::prolong_add::<C>(values, &mut prolonged, &ActiveNodes::new(fine, |_| true));
    prolonged
}

/// `target = parameters (+ base)` at the active nodes.
fn sum_active<const C: usize>(
    target: &mut [f32],
    parameters: &mut [f32],
    base: Option<&Vec<f32>>,
    active: &ActiveNodes,
) {
    let layer = C * active.grid().nodes().pow(2);
    let parameters = active.split_layers(C, parameters);
    target.par_chunks_mut(layer).zip(parameters).enumerate().for_each(|(z, (target, parameters))| {
        let mut rest: &[f32] = parameters;
        for &(start, length) in active.layer(z) {
            let range = C * start as usize..C * (start + length) as usize;
            let (own, others) = rest.split_at(range.len());
            let out = &mut target[range.start - z * layer..range.end - z * layer];
            match base {
                Some(base) => out.iter_mut().zip(own).zip(&base[range]).for_each(|((o, p), b)| *o = p + b),
                None => out.copy_from_slice(own),
            }
            rest = others;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_lowers_the_value_under_a_positive_gradient_at_every_level() {
        let grid = VoxelGrid::new(9, 0.5);
        let active = ActiveNodes::new(&grid, |node| grid.position(node).length() < 0.3);
        let mut levels = MultiResGrid::<1>::new(active, vec![1.0; grid.len()], 2);
        let middle = grid.index([4, 4, 4]);
        levels.values_and_gradient_mut().1[middle] = 1.0;
        levels.step(|level| if level == 1 { 0.1 } else { 0.0 });
        // Only the middle level moved: by its rate at its node, half of it half way to the next one.
        assert!((levels.values()[middle] - 0.9).abs() < 1e-5);
        assert!((levels.values()[grid.index([5, 4, 4])] - 0.95).abs() < 1e-5);
        assert_eq!(levels.values()[0], 1.0, "not active");
    }

    #[test]
    fn nodes_without_a_gradient_go_to_rest() {
        let grid = VoxelGrid::new(9, 0.5);
        let active = ActiveNodes::new(&grid, |node| grid.position(node).length() < 0.3);
        let mut levels = MultiResGrid::<1>::new(active, vec![1.0; grid.len()], 1);
        for _ in 0..200 {
            levels.values_and_gradient_mut().1.fill(0.0);
            levels.pull_towards([0.7], 1e-3);
            levels.step(|_| 5e-3);
        }
        assert!((levels.values()[grid.index([4, 4, 4])] - 0.7).abs() < 0.02);
        assert_eq!(levels.values()[0], 1.0, "not active");
    }

    #[test]
    fn a_frozen_base_keeps_the_function_and_what_is_stored_brings_it_back() {
        let (coarse, fine) = (VoxelGrid::new(9, 0.5), VoxelGrid::new(17, 0.5));
        let learned: Vec<f32> = (0..coarse.len()).map(|node| ((node * 7919) % 13) as f32 - 6.0).collect();
        let near = || ActiveNodes::new(&fine, |node| fine.position(node).length() < 0.2);
        let on_frozen_base =
            |learned: &[f32]| MultiResGrid::<1>::on_frozen_base(near(), prolonged::<1>(learned, &fine), 2);
        let mut levels = on_frozen_base(&learned);
        for node in 0..fine.len() {
            assert!((levels.values()[node] - coarse.value(&learned, fine.position(node))).abs() < 1e-5, "{node}");
        }
        assert_eq!(levels.learned().unwrap(), learned);
        levels.values_and_gradient_mut().1.fill(1.0);
        levels.step(|_| 0.1);
        let mut again = on_frozen_base(&levels.learned().unwrap());
        assert!(again.restore(&levels.state()));
        assert_eq!(again.values(), levels.values());
    }

    #[test]
    fn refining_keeps_the_function() {
        let (coarse, fine) = (VoxelGrid::new(9, 0.5), VoxelGrid::new(17, 0.5));
        let near = |grid: &VoxelGrid, radius: f32| ActiveNodes::new(grid, |node| grid.position(node).length() < radius);
        let mut levels = MultiResGrid::<1>::new(near(&coarse, 0.4), vec![0.0; coarse.len()], 1);
        for node in 0..coarse.len() {
            levels.values_and_gradient_mut().1[node] = ((node * 7919) % 13) as f32 - 6.0;
        }
        levels.step(|_| 0.1);
        // Well inside the band: at its border nodes become active that were not.
        let refined = levels.refined(near(&fine, 0.15), vec![0.0; fine.len()]);
        for node in refined.active().iter() {
            let expected = coarse.value(levels.values(), fine.position(node));
            assert!((refined.values()[node] - expected).abs() < 1e-5, "{node}");
        }
    }
}
