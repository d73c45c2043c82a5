//! Parameters on nested grids, from coarse to fine, whose sum is one fine grid.

use std::sync::Arc;

use dvr_core::voxel::VoxelGrid;
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use super::adam::{Adam, AdamStep, Moments};
use super::pyramid::{Around, restrict};
use crate::active::ActiveNodes;
use crate::bricks::{Brick, BrickLayout, BrickValues, EDGE, Row, Stored};
use crate::constants;

/// The parameters of one grid, in rows with active nodes.
#[derive(Clone, Debug)]
struct Level<const C: usize> {
    active: ActiveNodes,
    layout: Arc<BrickLayout>,
    /// Zero at nodes that are not active, as moments and gradient are.
    parameters: Vec<Row<C>>,
    moments: Moments<C>,
    gradient: Vec<Row<C>>,
    /// Sum of this level and the coarser ones; empty at the finest, whose sum is the grid's values.
    sum: Vec<Row<C>>,
}

/// Nested grids of `C` channels per node. A coarse node moves all fine ones around it: gradients reach far at once,
/// and the fine levels add the detail. The sum is kept as values at the finest nodes, the only ones that are ever
/// sampled.
#[derive(Clone, Debug)]
pub(crate) struct MultiResGrid<const C: usize> {
    /// Coarse to fine; at least one.
    levels: Vec<Level<C>>,
    /// What is added to the sum of the levels, at the finest rows with active nodes.
    base: Vec<Row<C>>,
    values: BrickValues<C>,
    steps: i32,
}

impl<const C: usize> MultiResGrid<C> {
    /// Zero parameters on top of `base`, at the active nodes of the finest grid and `coarser` coarser ones.
    pub fn new(active: ActiveNodes, base: &[f32], coarser: usize) -> Self {
        let values = BrickValues::dense(&active, base);
        Self::on(active, values, coarser)
    }

    /// Zero parameters at the active nodes and in `coarser` levels, on top of what earlier stages learned on a grid of
    /// half the cells, and of `detail`, `C` numbers per active node: where nothing is left to learn, nothing is stored and
    /// nothing is computed.
    pub fn on_frozen_base(active: ActiveNodes, learned: Arc<BrickValues<C>>, detail: &[f32], coarser: usize) -> Self {
        let mut values = BrickValues::refined(&active, learned);
        let layout = values.layout().clone();
        for ((slot, lane), detail) in layout.slots(&active).zip(detail.as_chunks::<C>().0) {
            let value = &mut values.rows_mut()[slot][lane];
            (0..C).for_each(|c| value[c] += detail[c]);
        }
        Self::on(active, values, coarser)
    }

    fn on(active: ActiveNodes, values: BrickValues<C>, coarser: usize) -> Self {
        let mut levels = vec![Level::new(active, values.layout().clone())];
        for _ in 0..coarser {
            let next = levels[levels.len() - 1].active.coarser();
            levels.push(Level::coarse(next));
        }
        levels.reverse();
        let base = values.rows()[..values.layout().active_rows()].to_vec();
        Self { levels, base, values, steps: 0 }
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

    /// What is added to the sum of the levels, `C` numbers per active node of the finest grid.
    #[cfg(feature = "gpu")]
    pub fn base(&self) -> Vec<f32> {
        self.finest().layout.of_rows(self.active(), &self.base)
    }

    /// The values at the finest nodes, all levels and the base summed.
    pub fn values(&self) -> &BrickValues<C> {
        &self.values
    }

    /// The values at the finest nodes, and the gradient by them at rows with active nodes. Before [`MultiResGrid::step`],
    /// it is to be written at active nodes, and to be zero at others.
    pub fn values_and_gradient_mut(&mut self) -> (&BrickValues<C>, &mut [Row<C>]) {
        let last = self.levels.len() - 1;
        (&self.values, &mut self.levels[last].gradient)
    }

    /// Adds the gradient of half `weight` times the squared distance to `rest` at every active node. However small, it
    /// moves what nothing else does: Adam's steps do not depend on a gradient's size.
    pub fn pull_towards(&mut self, rest: [f32; C], weight: f32) {
        let (values, gradient) = self.values_and_gradient_mut();
        let (layout, values) = (values.layout(), values.rows());
        let (rest, arch) = ([rest; EDGE], Arch::new());
        let tasks: Vec<_> = layout.tasks().zip(layout.split(gradient)).collect();
        tasks.into_par_iter().for_each(|(bricks, gradient)| {
            arch.dispatch(Pull { bricks, layout, values, rest: &rest, weight, gradient });
        });
    }

    /// Whether anything differs from how levels start: a step was done, or a parameter moved.
    #[cfg(feature = "gpu")]
    pub fn is_touched(&self) -> bool {
        let moved = |level: &Level<C>| level.parameters.par_iter().any(|row| *row != [[0.0; C]; EDGE]);
        self.steps > 0 || self.levels.iter().any(moved)
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
    pub fn refined(&self, active: ActiveNodes, base: &[f32]) -> Self {
        let mut levels: Vec<Level<C>> = Vec::new();
        let mut coarser = active.coarser();
        for level in self.levels.iter().rev() {
            // A node that becomes active was zero so far; one that no longer is keeps what it has.
            let active = ActiveNodes::union(&coarser, &level.active);
            if levels.len() + 1 < self.levels.len() {
                coarser = active.coarser();
            }
            levels.push(level.carried(active));
        }
        levels.reverse();
        let Self { levels: finest, base, values, .. } = Self::new(active, base, 0);
        levels.extend(finest);
        let mut refined = Self { levels, base, values, steps: self.steps };
        refined.descend(None::<fn(usize) -> f32>);
        refined
    }

    /// Adds to the parameters of the finest level, `C` numbers per active node.
    pub fn add_to_finest(&mut self, by: &[f32]) {
        let last = self.levels.len() - 1;
        let Level { active, layout, parameters, .. } = &mut self.levels[last];
        let by = layout.rows_of::<C>(active, by);
        let parameters = parameters.as_flattened_mut().as_flattened_mut();
        parameters.iter_mut().zip(by.as_flattened().as_flattened()).for_each(|(parameter, by)| *parameter += by);
        self.descend(None::<fn(usize) -> f32>);
    }

    /// What earlier stages learned, of levels on a frozen base; see [`BrickValues::learned`].
    pub fn learned(&self) -> Option<Vec<f32>> {
        self.values.coarser().map(|coarser| coarser.learned())
    }

    /// One step of Adam against the gradient, then the sum again. `rates` gives the step size of each level, coarse to
    /// fine.
    pub fn step(&mut self, rates: impl Fn(usize) -> f32) {
        for i in (1..self.levels.len()).rev() {
            let (coarse, fine) = self.levels.split_at_mut(i);
            let (coarse, fine) = (&mut coarse[i - 1], &fine[0]);
            restrict(&fine.layout, &fine.gradient, &coarse.layout, &mut coarse.gradient);
        }
        self.steps += 1;
        self.descend(Some(rates));
    }

    /// Steps done, and parameters and moments at the active nodes, in one row.
    pub fn state(&self) -> Vec<f32> {
        let mut state = vec![self.steps as f32];
        for Level { active, layout, parameters, moments, .. } in &self.levels {
            for rows in [parameters, &moments.first, &moments.second] {
                state.extend(layout.of_rows(active, rows));
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
        for Level { active, layout, parameters, moments, .. } in &mut self.levels {
            for rows in [parameters, &mut moments.first, &mut moments.second] {
                let (own, others) = rest.split_at(C * active.count());
                *rows = layout.rows_of(active, own);
                rest = others;
            }
        }
        self.descend(None::<fn(usize) -> f32>);
        true
    }

    fn finest(&self) -> &Level<C> {
        &self.levels[self.levels.len() - 1]
    }

    /// Moves the parameters by these step sizes, if any, and sums base and levels: each level once, coarse to fine.
    fn descend(&mut self, rates: Option<impl Fn(usize) -> f32>) {
        let (beta1, beta2, epsilon) = (constants::BETA1, constants::BETA2, constants::EPSILON);
        let last = self.levels.len() - 1;
        for i in 0..=last {
            let settings = rates.as_ref().map(|rates| AdamStep {
                learning_rate: rates(i),
                beta1,
                beta2,
                epsilon,
                step: self.steps,
            });
            let (coarser, level) = self.levels.split_at_mut(i);
            let (coarser, level) = (coarser.last(), &mut level[0]);
            if i == last {
                level.descend(coarser, settings.as_ref(), Some(&self.base), self.values.rows_mut());
            } else {
                let mut sum = std::mem::take(&mut level.sum);
                sum.resize(level.layout.active_rows(), [[0.0; C]; EDGE]);
                level.descend(coarser, settings.as_ref(), None, &mut sum);
                level.sum = sum;
            }
        }
    }
}

impl<const C: usize> Level<C> {
    fn new(active: ActiveNodes, layout: Arc<BrickLayout>) -> Self {
        let zero = vec![[[0.0; C]; EDGE]; layout.active_rows()];
        let moments = Moments::new(layout.active_rows());
        Self { active, layout, parameters: zero.clone(), moments, gradient: zero, sum: Vec::new() }
    }

    /// One that is not the finest.
    fn coarse(active: ActiveNodes) -> Self {
        let layout = Arc::new(BrickLayout::new(&active, Stored::Active));
        Self::new(active, layout)
    }

    /// The same with other active nodes: parameters of new ones are zero.
    fn carried(&self, active: ActiveNodes) -> Self {
        let level = Self::coarse(active);
        let carried = |rows: &[Row<C>]| {
            let stored = self.layout.of_rows(&self.active, rows);
            level.layout.rows_of(&level.active, &self.active.carried(C, &stored, &level.active))
        };
        let parameters = carried(&self.parameters);
        let moments = Moments { first: carried(&self.moments.first), second: carried(&self.moments.second) };
        Self { parameters, moments, ..level }
    }

    /// Moves the parameters, where there are settings, and writes `sum`: that of the parameters, the base and the coarser
    /// levels at active nodes.
    fn descend(
        &mut self,
        coarser: Option<&Self>,
        settings: Option<&AdamStep>,
        base: Option<&[Row<C>]>,
        sum: &mut [Row<C>],
    ) {
        let Self { layout, parameters, moments, gradient, .. } = self;
        let parts = layout.split(parameters).into_iter().zip(layout.split(sum));
        let moments = layout.split(&mut moments.first).into_iter().zip(layout.split(&mut moments.second));
        let tasks: Vec<_> = layout.tasks().zip(parts).zip(moments).collect();
        let arch = Arch::new();
        tasks.into_par_iter().for_each(|((bricks, (parameters, sum)), (first, second))| {
            let own = bricks[0].rows().start..bricks[bricks.len() - 1].rows().end;
            if let Some(settings) = settings {
                let parameters = parameters.as_flattened_mut().as_flattened_mut();
                let gradient = gradient[own.clone()].as_flattened().as_flattened();
                let first = first.as_flattened_mut().as_flattened_mut();
                let second = second.as_flattened_mut().as_flattened_mut();
                arch.dispatch(Adam { parameters, gradient, first, second, settings });
            }
            let base = base.map(|base| &base[own]);
            arch.dispatch(Sum { bricks, layout, parameters, base, coarser, sum });
        });
    }
}

/// Adds to the gradient at the active nodes of some bricks what pulls their values towards rest.
struct Pull<'a, const C: usize> {
    bricks: &'a [Brick],
    layout: &'a BrickLayout,
    values: &'a [Row<C>],
    rest: &'a Row<C>,
    weight: f32,
    gradient: &'a mut [Row<C>],
}

/// Compiled for each instruction set: a closure would not be.
impl<const C: usize> NullaryFnOnce for Pull<'_, C> {
    type Output = ();

    #[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
    #[inline(always)]
    fn call(self) {
        let Self { bricks, layout, values, rest, weight, gradient } = self;
        let slots = bricks[0].rows().start..bricks[bricks.len() - 1].rows().end;
        for (slot, gradient) in slots.zip(gradient) {
            let (active, row) = (layout.active_lanes(slot), &values[slot]);
            for lane in 0..EDGE {
                for c in 0..C {
                    gradient[lane][c] += weight * (row[lane][c] - rest[lane][c]) * active[lane];
                }
            }
        }
    }
}

/// Writes the sum of parameters, base and coarser levels at the active nodes of some bricks; at others, the base.
struct Sum<'a, const C: usize> {
    bricks: &'a [Brick],
    layout: &'a BrickLayout,
    parameters: &'a [Row<C>],
    base: Option<&'a [Row<C>]>,
    coarser: Option<&'a Level<C>>,
    sum: &'a mut [Row<C>],
}

/// Compiled for each instruction set: a closure would not be.
impl<const C: usize> NullaryFnOnce for Sum<'_, C> {
    type Output = ();

    #[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
    #[inline(always)]
    fn call(self) {
        let Self { bricks, layout, parameters, base, coarser, sum } = self;
        let first = bricks[0].rows().start;
        let mut around = Around::nothing();
        for brick in bricks {
            if let Some(coarser) = coarser {
                around.take(&coarser.layout, &coarser.sum, brick);
            }
            for slot in brick.rows() {
                let [_, y, z] = layout.place(brick, slot);
                let mut row = parameters[slot - first];
                if let Some(base) = base {
                    plus(&mut row, &base[slot - first]);
                }
                if coarser.is_some() {
                    // Where a node is not active, its parameter is zero, and its value does not move.
                    let (active, from_coarser) = (layout.active_lanes(slot), around.interpolated(y % EDGE, z % EDGE));
                    for lane in 0..EDGE {
                        for c in 0..C {
                            row[lane][c] += from_coarser[lane][c] * active[lane];
                        }
                    }
                }
                sum[slot - first] = row;
            }
        }
    }
}

#[inline(always)]
fn plus<const C: usize>(row: &mut Row<C>, other: &Row<C>) {
    row.as_flattened_mut().iter_mut().zip(other.as_flattened()).for_each(|(a, b)| *a += b);
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::multires::dense;

    /// Writes the gradient by the value of each active node, given for all nodes.
    fn write<const C: usize>(levels: &mut MultiResGrid<C>, gradient: &[f32]) {
        let active = levels.active().clone();
        let given: Vec<f32> = active.iter().flat_map(|node| &gradient[C * node..C * (node + 1)]).copied().collect();
        let (values, rows) = levels.values_and_gradient_mut();
        rows.copy_from_slice(&values.layout().rows_of(&active, &given));
    }

    fn random(rng: &mut ChaCha8Rng, count: usize) -> Vec<f32> {
        (0..count).map(|_| rng.random::<f32>() - 0.5).collect()
    }

    #[test]
    fn a_step_lowers_the_value_under_a_positive_gradient_at_every_level() {
        let grid = VoxelGrid::new(9, 0.5);
        let active = ActiveNodes::new(&grid, |node| grid.position(node).length() < 0.3);
        let mut levels = MultiResGrid::<1>::new(active, &vec![1.0; grid.len()], 2);
        let middle = grid.index([4, 4, 4]);
        let mut gradient = vec![0.0; grid.len()];
        gradient[middle] = 1.0;
        write(&mut levels, &gradient);
        levels.step(|level| if level == 1 { 0.1 } else { 0.0 });
        // Only the middle level moved: by its rate at its node, half of it half way to the next one.
        assert!((levels.values().at([4; 3])[0] - 0.9).abs() < 1e-5);
        assert!((levels.values().at([5, 4, 4])[0] - 0.95).abs() < 1e-5);
        assert_eq!(levels.values().at([0; 3]), [1.0], "not active");
    }

    #[test]
    fn nodes_without_a_gradient_go_to_rest() {
        let grid = VoxelGrid::new(9, 0.5);
        let active = ActiveNodes::new(&grid, |node| grid.position(node).length() < 0.3);
        let mut levels = MultiResGrid::<1>::new(active, &vec![1.0; grid.len()], 1);
        for _ in 0..200 {
            write(&mut levels, &vec![0.0; grid.len()]);
            levels.pull_towards([0.7], 1e-3);
            levels.step(|_| 5e-3);
        }
        assert!((levels.values().at([4; 3])[0] - 0.7).abs() < 0.02);
        assert_eq!(levels.values().at([0; 3]), [1.0], "not active");
    }

    #[test]
    fn a_frozen_base_keeps_the_function_and_what_is_stored_brings_it_back() {
        let (coarse, fine) = (VoxelGrid::new(9, 0.5), VoxelGrid::new(17, 0.5));
        let learned: Vec<f32> = (0..coarse.len()).map(|node| ((node * 7919) % 13) as f32 - 6.0).collect();
        let near = || ActiveNodes::new(&fine, |node| fine.position(node).length() < 0.2);
        let on_frozen_base = |learned: &[f32]| {
            MultiResGrid::<1>::on_frozen_base(near(), Arc::new(BrickValues::of_grid(&coarse, learned)), &[], 2)
        };
        let mut levels = on_frozen_base(&learned);
        for (node, value) in levels.values().to_dense().into_iter().enumerate() {
            assert!((value - coarse.value(&learned, fine.position(node))).abs() < 1e-5, "{node}");
        }
        assert_eq!(levels.learned().unwrap(), learned);
        write(&mut levels, &vec![1.0; fine.len()]);
        levels.step(|_| 0.1);
        let mut again = on_frozen_base(&levels.learned().unwrap());
        assert!(again.restore(&levels.state()));
        assert_eq!(again.values().to_dense(), levels.values().to_dense());
    }

    #[test]
    fn refining_keeps_the_function() {
        let (coarse, fine) = (VoxelGrid::new(9, 0.5), VoxelGrid::new(17, 0.5));
        let near = |grid: &VoxelGrid, radius: f32| ActiveNodes::new(grid, |node| grid.position(node).length() < radius);
        let mut levels = MultiResGrid::<1>::new(near(&coarse, 0.4), &vec![0.0; coarse.len()], 1);
        let gradient: Vec<f32> = (0..coarse.len()).map(|node| ((node * 7919) % 13) as f32 - 6.0).collect();
        write(&mut levels, &gradient);
        levels.step(|_| 0.1);
        // Well inside the band: at its border nodes become active that were not.
        let refined = levels.refined(near(&fine, 0.15), &vec![0.0; fine.len()]);
        for node in refined.active().iter() {
            let expected = levels.values().value(fine.position(node));
            assert!((refined.values().at(fine.coordinates(node))[0] - expected).abs() < 1e-5, "{node}");
        }
    }

    /// Steps against random gradients, in bricks and on dense grids: bit for bit the same.
    fn steps_are_those_of_dense_grids<const C: usize>(grid: &VoxelGrid, active: &ActiveNodes, coarser: usize) {
        let mut rng = ChaCha8Rng::seed_from_u64(grid.len() as u64 + active.count() as u64);
        let base = random(&mut rng, C * grid.len());
        let mut levels = MultiResGrid::<C>::new(active.clone(), &base, coarser);
        let mut reference = dense::Levels::<C>::new(active.clone(), base, coarser);
        for _ in 0..3 {
            let mut gradient = random(&mut rng, C * grid.len());
            let mut is_active = vec![false; grid.len()];
            active.iter().for_each(|node| is_active[node] = true);
            (0..C * grid.len()).filter(|i| !is_active[i / C]).for_each(|i| gradient[i] = 0.0);
            write(&mut levels, &gradient);
            let rate = |level: usize| 0.1 / (1 + level) as f32;
            levels.step(rate);
            reference.step(&gradient, rate);
            assert_eq!(levels.values().to_dense(), reference.values);
        }
    }

    #[test]
    fn steps_in_bricks_are_those_of_dense_grids_whatever_is_active() {
        for nodes in [17, 33, 41] {
            let grid = VoxelGrid::new(nodes, 0.5);
            let last = nodes - 1;
            let sets: [&dyn Fn(usize) -> bool; 6] = [
                &|_| true,
                &|_| false,
                &|node| node == grid.index([last, 0, last]),
                &|node| (grid.position(node).length() - 0.3).abs() < 2.5 * grid.spacing(),
                &|node| node.wrapping_mul(2_654_435_761) % 7 < 2,
                // A band at the border of the cube, and one brick alone.
                &|node| grid.coordinates(node)[2] < 3 || grid.coordinates(node).iter().all(|&c| c / 8 == 1),
            ];
            for is_active in sets {
                let active = ActiveNodes::new(&grid, is_active);
                steps_are_those_of_dense_grids::<1>(&grid, &active, 3);
                steps_are_those_of_dense_grids::<3>(&grid, &active, 1);
            }
        }
    }
}
