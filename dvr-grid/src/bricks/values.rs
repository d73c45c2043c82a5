//! Numbers at the nodes of a grid, of which some rows are stored.

use std::sync::Arc;

use dvr_core::voxel::{Cell, VoxelGrid};
use glam::Vec3;
use rayon::prelude::*;

use super::layout::{BrickLayout, EDGE, Row, Stored};
use crate::active::ActiveNodes;

/// What pads rows that end beyond the grid: outside.
const PADDING: f32 = -1.0;

/// `C` numbers at each node of a grid. Those of stored rows are at hand; the others follow from a coarser grid, with the
/// same rounding whenever they are asked for, or from the side of the surface that they are on.
#[derive(Clone, Debug)]
pub(crate) struct BrickValues<const C: usize> {
    layout: Arc<BrickLayout>,
    /// The stored rows and one more, for neighbours that are not there.
    rows: Vec<Row<C>>,
    others: Others<C>,
}

/// Where the numbers come from that are not stored.
#[derive(Clone, Debug)]
enum Others<const C: usize> {
    /// They are interpolated.
    Coarser(Arc<BrickValues<C>>),
    /// They are the same everywhere out of the surface, and everywhere within.
    Sides([[f32; C]; 2]),
}

impl<const C: usize> BrickValues<C> {
    /// All numbers of a grid; rows with active nodes come first.
    ///
    /// # Panics
    /// When there are not `C` numbers per node.
    pub fn dense(active: &ActiveNodes, values: &[f32]) -> Self {
        let grid = active.grid();
        assert_eq!(values.len(), C * grid.len(), "{C} numbers per node");
        let values = values.as_chunks::<C>().0;
        let layout = BrickLayout::new(active, Stored::All);
        Self::filled(layout, Others::Sides([[0.0; C]; 2]), |[x, y, z]| values[grid.index([x, y, z])])
    }

    /// All numbers of a grid.
    ///
    /// # Panics
    /// When there are not `C` numbers per node.
    pub fn of_grid(grid: &VoxelGrid, values: &[f32]) -> Self {
        Self::dense(&ActiveNodes::none(grid), values)
    }

    /// What a grid of half the cells has, interpolated: stored are the corners of all cells around active nodes. Elsewhere
    /// the first numbers of neighbours must have the same sign, as they have out of a band around the surface.
    pub fn refined(active: &ActiveNodes, coarser: Arc<Self>) -> Self {
        let mut layout = BrickLayout::new(active, Stored::Around);
        layout.set_sides(|at| coarser.between(at)[0] >= 0.0);
        let from = coarser.clone();
        Self::filled(layout, Others::Coarser(coarser), move |at| from.between(at))
    }

    /// Numbers at the active nodes, in their order; zero at all others.
    pub fn of_active(active: &ActiveNodes, given: &[f32]) -> Self {
        Self::between_sides(active, given, [[0.0; C]; 2], |_| false)
    }

    /// Numbers at the active nodes, in their order; at the others those of the side that they are on: out of the surface
    /// or within.
    pub fn between_sides(
        active: &ActiveNodes,
        given: &[f32],
        sides: [[f32; C]; 2],
        is_inside: impl Fn([usize; 3]) -> bool + Sync,
    ) -> Self {
        let mut layout = BrickLayout::new(active, Stored::Active);
        layout.set_sides(&is_inside);
        let mut values = Self::filled(layout, Others::Sides(sides), |at| sides[usize::from(is_inside(at))]);
        let layout = values.layout.clone();
        for ((slot, lane), given) in layout.slots(active).zip(given.as_chunks::<C>().0) {
            values.rows[slot][lane] = *given;
        }
        values
    }

    fn filled(layout: BrickLayout, others: Others<C>, of: impl Fn([usize; 3]) -> [f32; C] + Sync) -> Self {
        let nodes = layout.grid().nodes();
        let mut rows = vec![[[PADDING; C]; EDGE]; layout.stored_rows() + 1];
        let stored_of = |brick: &super::Brick| {
            let [x, y, z] = brick.at.map(|at| at * EDGE);
            let places = (0..EDGE).flat_map(|dz| (0..EDGE).map(move |dy| (dy, dz)));
            let row = |(dy, dz)| {
                let slot = brick.row(dy, dz)?;
                let mut row = [[PADDING; C]; EDGE];
                let there = &mut row[..EDGE.min(nodes - x)];
                there.iter_mut().enumerate().for_each(|(lane, value)| *value = of([x + lane, y + dy, z + dz]));
                Some((slot, row))
            };
            places.filter_map(row).collect::<Vec<_>>()
        };
        for bricks in layout.tasks().collect::<Vec<_>>().chunks(64) {
            let found: Vec<_> = bricks.par_iter().flat_map_iter(|bricks| bricks.iter().map(stored_of)).collect();
            found.into_iter().flatten().for_each(|(slot, row)| rows[slot] = row);
        }
        Self { layout: Arc::new(layout), rows, others }
    }

    /// The grid.
    pub fn grid(&self) -> &VoxelGrid {
        self.layout.grid()
    }

    /// Which rows are stored.
    pub fn layout(&self) -> &Arc<BrickLayout> {
        &self.layout
    }

    /// The stored rows, those with active nodes first, and one more.
    pub fn rows(&self) -> &[Row<C>] {
        &self.rows
    }

    /// The same, to be changed at active nodes.
    pub fn rows_mut(&mut self) -> &mut [Row<C>] {
        &mut self.rows
    }

    /// What is not stored is interpolated from this, if from anything.
    pub fn coarser(&self) -> Option<&Arc<Self>> {
        match &self.others {
            Others::Coarser(coarser) => Some(coarser),
            Others::Sides(_) => None,
        }
    }

    /// What does not follow from anything else. Without a coarser grid that is all numbers; with one, what it has, and then
    /// the numbers at active nodes, row by row.
    pub fn learned(&self) -> Vec<f32> {
        let Some(coarser) = self.coarser() else { return self.to_dense() };
        let mut learned = coarser.learned();
        self.layout.active_places().for_each(|(slot, lane)| learned.extend_from_slice(&self.rows[slot][lane]));
        learned
    }

    /// The same grid with what its active nodes, or all of its nodes, learned: the first numbers of `learned`, which are
    /// taken away from it. `None` where there are too few.
    pub fn with_learned(&self, learned: &mut &[f32]) -> Option<Self> {
        if self.coarser().is_none() {
            return Some(Self::of_grid(self.grid(), learned.split_off(..C * self.grid().len())?));
        }
        let mut values = self.clone();
        for (slot, lane) in self.layout.active_places() {
            values.rows[slot][lane].copy_from_slice(learned.split_off(..C)?);
        }
        Some(values)
    }

    /// The same with these numbers at the active nodes, given in their order.
    #[cfg(feature = "gpu")]
    pub fn with_active(&self, active: &ActiveNodes, given: &[f32]) -> Self {
        let mut values = self.clone();
        for ((slot, lane), given) in self.layout.slots(active).zip(given.as_chunks::<C>().0) {
            values.rows[slot][lane] = *given;
        }
        values
    }

    /// The active nodes, row by row, and their numbers: all that is not interpolated, where there is a coarser grid.
    #[cfg(feature = "gpu")]
    pub fn active_nodes(&self) -> (Vec<u32>, Vec<f32>) {
        let nodes = self.layout.active_indices().map(|node| node as u32).collect();
        let numbers = self.layout.active_places().flat_map(|(slot, lane)| self.rows[slot][lane]).collect();
        (nodes, numbers)
    }

    /// The numbers of a node.
    #[inline]
    pub fn at(&self, at: [usize; 3]) -> [f32; C] {
        match self.layout.slot(at) {
            Some((slot, lane)) => self.rows[slot][lane],
            None => self.beyond(at),
        }
    }

    #[cold]
    fn beyond(&self, at: [usize; 3]) -> [f32; C] {
        match &self.others {
            Others::Coarser(coarser) => coarser.between(at),
            Others::Sides(sides) => sides[usize::from(self.layout.is_inside(at))],
        }
    }

    /// The numbers that a node of a grid of twice the cells has by interpolation: along y and z first, as
    /// `pyramid::interpolated` rounds.
    pub fn between(&self, [x, y, z]: [usize; 3]) -> [f32; C] {
        let (ys, zs) = ([y / 2, y.div_ceil(2)], [z / 2, z.div_ceil(2)]);
        let blend = |x: usize| -> [f32; C] {
            let [a, b, c, d] =
                [[ys[0], zs[0]], [ys[1], zs[0]], [ys[0], zs[1]], [ys[1], zs[1]]].map(|[y, z]| self.at([x, y, z]));
            std::array::from_fn(|i| 0.25 * (a[i] + b[i] + c[i] + d[i]))
        };
        let (low, high) = (blend(x / 2), blend(x.div_ceil(2)));
        std::array::from_fn(|i| 0.5 * (low[i] + high[i]))
    }

    /// The numbers at the corners of a cell, x fastest.
    #[inline]
    pub fn corners(&self, [x, y, z]: [usize; 3]) -> [[f32; C]; 8] {
        let lane = x % EDGE;
        // Most cells lie within a brick that stores all their corners.
        if lane + 1 < EDGE
            && let Some([a, b, c, d]) = self.layout.rows_around([x, y, z])
        {
            let pair = |slot: usize| [self.rows[slot][lane], self.rows[slot][lane + 1]];
            let ([a, b], [c, d], [e, f], [g, h]) = (pair(a), pair(b), pair(c), pair(d));
            return [a, b, c, d, e, f, g, h];
        }
        let pair = |y: usize, z: usize| [self.at([x, y, z]), self.at([x + 1, y, z])];
        let ([a, b], [c, d]) = (pair(y, z), pair(y + 1, z));
        let ([e, f], [g, h]) = (pair(y, z + 1), pair(y + 1, z + 1));
        [a, b, c, d, e, f, g, h]
    }

    /// The numbers of all nodes.
    pub fn to_dense(&self) -> Vec<f32> {
        let grid = self.grid();
        let plane = grid.nodes().pow(2);
        let mut dense = vec![0.0; C * grid.len()];
        dense.par_chunks_mut(C * plane).enumerate().for_each(|(z, layer)| {
            for (node, value) in layer.as_chunks_mut::<C>().0.iter_mut().enumerate() {
                *value = self.at([node % grid.nodes(), node / grid.nodes(), z]);
            }
        });
        dense
    }
}

impl BrickValues<1> {
    /// The corners of a point's cell.
    #[inline]
    pub fn cell(&self, cell: &Cell) -> [f32; 8] {
        self.corners(self.grid().coordinates(cell.node)).map(|[value]| value)
    }

    /// The interpolated value at a point.
    pub fn value(&self, point: Vec3) -> f32 {
        let cell = self.grid().locate(point);
        cell.value(&self.cell(&cell))
    }

    /// The interpolated value at a point and its gradient in space.
    pub fn value_and_gradient(&self, point: Vec3) -> (f32, Vec3) {
        let cell = self.grid().locate(point);
        let (value, gradient) = cell.value_and_gradient(&self.cell(&cell));
        (value, gradient / self.grid().spacing())
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn random(count: usize, seed: u64) -> Vec<f32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(|_| rng.random::<f32>() - 0.5).collect()
    }

    /// All corners of all cells.
    fn assert_corners<const C: usize>(values: &BrickValues<C>, dense: &[f32]) {
        let grid = values.grid();
        for cell in 0..grid.cells().pow(3) {
            let at = [cell % grid.cells(), cell / grid.cells() % grid.cells(), cell / grid.cells().pow(2)];
            let expected = grid.corner_offsets().map(|offset| dense.as_chunks::<C>().0[grid.index(at) + offset]);
            assert_eq!(values.corners(at), expected, "{at:?}");
        }
    }

    #[test]
    fn all_bricks_are_the_dense_grid() {
        for nodes in [2, 5, 8, 9, 17, 20] {
            let grid = VoxelGrid::new(nodes, 0.5);
            let dense = random(3 * grid.len(), nodes as u64);
            let values = BrickValues::<3>::of_grid(&grid, &dense);
            assert_eq!(values.to_dense(), dense);
            assert_corners(&values, &dense);
        }
    }

    #[test]
    fn what_was_learned_makes_each_grid_again_and_nothing_is_kept_twice() {
        let grids = [9, 17, 33].map(|nodes| VoxelGrid::new(nodes, 0.5));
        let near = |grid: &VoxelGrid| ActiveNodes::new(grid, |node| (grid.position(node).length() - 0.3).abs() < 0.1);
        let mut stages = vec![BrickValues::<3>::of_grid(&grids[0], &random(3 * grids[0].len(), 6))];
        for grid in &grids[1..] {
            let started = BrickValues::refined(&near(grid), Arc::new(stages[stages.len() - 1].clone()));
            let numbers = random(3 * near(grid).count(), 7);
            let moved = started.with_learned(&mut numbers.as_slice()).unwrap();
            assert!(moved.to_dense() != started.to_dense());
            stages.push(moved);
        }
        let learned = stages[2].learned();
        let kept: usize = grids[0].len() + grids[1..].iter().map(|grid| near(grid).count()).sum::<usize>();
        assert_eq!(learned.len(), 3 * kept);
        let mut rest = learned.as_slice();
        let mut again =
            BrickValues::<3>::of_grid(&grids[0], &vec![0.0; 3 * grids[0].len()]).with_learned(&mut rest).unwrap();
        for (grid, stage) in grids[1..].iter().zip(&stages[1..]) {
            let started = BrickValues::refined(&near(grid), Arc::new(again));
            let too_few = &rest[..near(grid).count()];
            assert!(started.with_learned(&mut &too_few[..]).is_none());
            again = started.with_learned(&mut rest).unwrap();
            assert_eq!(again.to_dense(), stage.to_dense());
        }
        assert!(rest.is_empty());
    }

    #[test]
    fn what_is_not_stored_is_the_coarse_grid_whatever_is_active() {
        let (coarse, fine) = (VoxelGrid::new(11, 0.5), VoxelGrid::new(21, 0.5));
        let learned = random(coarse.len(), 3);
        let expected: Vec<f32> = (0..fine.len()).map(|node| coarse.value(&learned, fine.position(node))).collect();
        let sets: [&dyn Fn(usize) -> bool; 5] = [
            &|_| false,
            &|node| node == fine.index([8, 7, 16]),
            &|node| node.wrapping_mul(2_654_435_761) % 101 == 0,
            &|node| fine.coordinates(node)[0] == 0,
            &|_| true,
        ];
        let mut dense = Vec::new();
        for is_active in sets {
            let active = ActiveNodes::new(&fine, is_active);
            let values = BrickValues::<1>::refined(&active, Arc::new(BrickValues::of_grid(&coarse, &learned)));
            let found = values.to_dense();
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6));
            assert!(dense.is_empty() || dense == found, "the same rounding whatever is stored");
            assert_corners(&values, &found);
            dense = found;
        }
    }
}
