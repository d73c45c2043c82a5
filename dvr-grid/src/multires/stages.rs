//! Stages in bricks against stages on dense grids, bit for bit: whatever the field is, wherever rays go, and however far
//! the surface moves.

use std::sync::Arc;

use dvr_core::voxel::VoxelGrid;
use glam::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{MultiResGrid, dense};
use crate::OccupancyBitmask;
use crate::active::ActiveNodes;
use crate::bricks::{BrickOccupancy, BrickValues, near_refined_surface};
use crate::field::{GridField, GridValues, file};

const HALF_EXTENT: f32 = 0.55;

/// Nodes to either side of the surface that learn.
const REACH: usize = 3;

/// A field as bricks, and the same as numbers at all nodes.
struct Learned<const C: usize> {
    bricks: Arc<BrickValues<C>>,
    all: Vec<f32>,
}

impl<const C: usize> Learned<C> {
    fn new(grid: &VoxelGrid, all: Vec<f32>) -> Self {
        Self { bricks: Arc::new(BrickValues::of_grid(grid, &all)), all }
    }
}

/// Levels in bricks, and their reference.
struct Both<const C: usize> {
    bricks: MultiResGrid<C>,
    dense: dense::Levels<C>,
}

impl<const C: usize> Both<C> {
    /// A stage that learns at the active nodes, from what was learned before it and random detail.
    fn on(active: &ActiveNodes, learned: Learned<C>, coarser: usize, rng: &mut ChaCha8Rng) -> Self {
        let mut base = dense::prolonged::<C>(&learned.all, active.grid());
        let detail = random(rng, C * active.count(), 0.1 * active.grid().spacing());
        for (node, detail) in active.iter().zip(detail.chunks(C)) {
            (0..C).for_each(|c| base[C * node + c] += detail[c]);
        }
        let bricks = MultiResGrid::on_frozen_base(active.clone(), learned.bricks, &detail, coarser);
        Self { bricks, dense: dense::Levels::new(active.clone(), base, coarser) }
    }

    /// A step against random gradients, of which `push` is the mean; the first moves a parameter by the rate.
    fn step(&mut self, push: f32, rate: f32, rng: &mut ChaCha8Rng) {
        let active = self.bricks.active().clone();
        let given: Vec<f32> = (0..C * active.count()).map(|_| push + rng.random::<f32>() - 0.5).collect();
        let mut gradient = vec![0.0; C * active.grid().len()];
        for (node, given) in active.iter().zip(given.chunks(C)) {
            gradient[C * node..C * (node + 1)].copy_from_slice(given);
        }
        let (values, rows) = self.bricks.values_and_gradient_mut();
        rows.copy_from_slice(&values.layout().rows_of(&active, &given));
        let rate = |level: usize| rate / (1 + level) as f32;
        self.bricks.step(rate);
        self.dense.step(&gradient, rate);
        self.assert_equal();
    }

    fn assert_equal(&self) {
        assert!(self.bricks.values().to_dense() == self.dense.values, "bit for bit");
    }

    fn learned(self) -> Learned<C> {
        Learned { bricks: Arc::new(self.bricks.values().clone()), all: self.dense.values }
    }
}

fn random(rng: &mut ChaCha8Rng, count: usize, width: f32) -> Vec<f32> {
    (0..count).map(|_| width * (rng.random::<f32>() - 0.5)).collect()
}

fn random_point(rng: &mut ChaCha8Rng) -> Vec3 {
    Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0
}

/// Rays from outside, from within the cube and with ends cross both at the same depth. Returns how many do.
fn compare_rays(shape: &Both<1>, occupancy: &BrickOccupancy, rng: &mut ChaCha8Rng) -> usize {
    let (values, all) = (shape.bricks.values(), &shape.dense.values);
    let reference = OccupancyBitmask::new(values.grid(), all);
    let is_crossed = |ray: usize| {
        let origin = random_point(rng) * if ray.is_multiple_of(4) { 0.5 } else { 2.0 };
        let direction = 0.6 * random_point(rng) - origin;
        let [from, to] = if ray.is_multiple_of(3) { [0.6 * rng.random::<f32>(), 1.1] } else { [0.0, f32::INFINITY] };
        let found = occupancy.first_crossing(values, origin, direction, from, to);
        assert_eq!(found, reference.first_crossing(all, origin, direction, from, to), "{origin} {direction} {from}");
        found.is_some()
    };
    (0..300).map(is_crossed).filter(|&is_crossed| is_crossed).count()
}

/// Points see the same, and the same is stored.
fn compare_fields(shape: &Both<1>, color: &Both<3>, rng: &mut ChaCha8Rng) {
    let bricks = GridField::of_bricks(shape.bricks.values().clone(), color.bricks.values().clone());
    let all = |grid: &VoxelGrid, values: &[f32]| GridValues { grid: *grid, values: values.to_vec() };
    let dense =
        GridField::new(all(shape.bricks.grid(), &shape.dense.values), all(color.bricks.grid(), &color.dense.values));
    for _ in 0..300 {
        let point = HALF_EXTENT * random_point(rng);
        assert_eq!(bricks.logit_and_gradient_at(point), dense.logit_and_gradient_at(point), "{point}");
        assert_eq!(bricks.color_at(point, None), dense.color_at(point, None), "{point}");
    }
    assert!(file::to_bytes(&bricks).unwrap() == file::to_bytes(&dense).unwrap(), "the same is stored");
}

/// Two stages of twice the cells each, whose surface random gradients move, and push across the whole band. Returns how
/// many rays met it, and how many nodes learned.
fn compare_stages(field: &dyn Fn(Vec3, f32) -> f32, rng: &mut ChaCha8Rng) -> [usize; 2] {
    let grid = VoxelGrid::new(17, HALF_EXTENT);
    let values = (0..grid.len()).map(|node| field(grid.position(node), rng.random())).collect();
    let mut shape = Learned::<1>::new(&grid, values);
    let of_color = VoxelGrid::new(9, HALF_EXTENT);
    let mut color = Learned::<3>::new(&of_color, random(rng, 3 * of_color.len(), 1.0));
    let (mut hits, mut learning) = (0, 0);
    for stage in 1..=2 {
        let grid = VoxelGrid::new((16 << stage) + 1, HALF_EXTENT);
        let active = near_refined_surface(&grid, &shape.bricks, REACH);
        assert_eq!(active, ActiveNodes::near_surface(&grid, &dense::prolonged::<1>(&shape.all, &grid), REACH));
        learning += active.count();
        let mut of_shape = Both::on(&active, shape, 1 + stage, rng);
        let mut of_color = Both::on(&active.coarser(), color, stage, rng);
        let mut occupancy = BrickOccupancy::new(of_shape.bricks.values());
        // To and fro within the band, and then as far as it reaches and further: a step moves by 16 spacings.
        let far = 16.0 * grid.spacing();
        let side = if rng.random() { 1.0 } else { -1.0 };
        for (push, rate) in [(0.0, 0.1 * far), (0.0, 0.1 * far), (side, far)] {
            hits += compare_rays(&of_shape, &occupancy, rng);
            of_shape.step(push, rate, rng);
            of_color.step(0.0, 0.1, rng);
            occupancy.update(of_shape.bricks.values());
        }
        hits += compare_rays(&of_shape, &occupancy, rng);
        compare_fields(&of_shape, &of_color, rng);
        (shape, color) = (of_shape.learned(), of_color.learned());
    }
    [hits, learning]
}

#[test]
fn stages_in_bricks_are_those_on_dense_grids_however_far_the_surface_moves() {
    for seed in 0..4 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let middle = 0.2 * random_point(&mut rng);
        let normal = random_point(&mut rng).normalize();
        let fields: [&dyn Fn(Vec3, f32) -> f32; 6] = [
            &|_, noise| noise - 0.9,
            &|at, _| 0.28 - (at - middle).length(),
            // Through the cube's border, and closed at it.
            &|at, _| 0.3 - (at - 0.5 * normal).length(),
            &|at, _| if at.abs().max_element() > 0.5 { -0.02 } else { (at - middle).dot(normal) },
            // A sheet of one layer of nodes; a rod.
            &|at, _| if (at.z - middle.z).abs() < 0.035 { 1e-3 } else { -0.05 },
            &|at, _| 0.05 - (at - middle).cross(normal).length(),
        ];
        for (index, field) in fields.into_iter().enumerate() {
            let [hits, learning] = compare_stages(field, &mut rng);
            assert!(hits > 50 && learning > 500, "seed {seed}, field {index}: {hits} hits, {learning} nodes");
        }
    }
}

#[test]
fn empty_and_full_grids_stay_as_they_are() {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    assert_eq!(compare_stages(&|_, noise| -noise - 0.01, &mut rng), [0, 0]);
    // Rays from outside meet a full cube at its border.
    let [hits, learning] = compare_stages(&|_, noise| noise, &mut rng);
    assert!(hits > 50 && learning == 0, "{hits} hits, {learning} nodes");
}

#[test]
fn nodes_that_are_held_stay_as_they_start_while_all_around_them_learn() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (coarse, fine) = (VoxelGrid::new(17, HALF_EXTENT), VoxelGrid::new(33, HALF_EXTENT));
    // A ball with a hollow, the middle of which is held empty; it gets larger with the second grid.
    let start = |grid: &VoxelGrid| -> Vec<f32> {
        let value = |at: Vec3| (0.4 - at.length()).min((at - 0.2 * Vec3::X).length() - 0.2);
        (0..grid.len()).map(|node| value(grid.position(node))).collect()
    };
    let learning = |grid: &VoxelGrid, held: f32| {
        let learns = |at: Vec3| at.length() < 0.48 && (at - 0.2 * Vec3::X).length() > held;
        ActiveNodes::new(grid, |node| learns(grid.position(node)))
    };
    let (active, base) = (learning(&coarse, 0.08), start(&coarse));
    let mut both =
        Both { bricks: MultiResGrid::<1>::new(active.clone(), &base, 2), dense: dense::Levels::new(active, base, 2) };
    (0..3).for_each(|_| both.step(0.0, 0.02, &mut rng));
    let (active, base) = (learning(&fine, 0.12), start(&fine));
    let mut both = Both {
        bricks: both.bricks.refined(active.clone(), &base),
        dense: both.dense.refined(active.clone(), base.clone()),
    };
    both.assert_equal();
    let mut occupancy = BrickOccupancy::new(both.bricks.values());
    for _ in 0..3 {
        both.step(-1.0, 0.05, &mut rng);
        occupancy.update(both.bricks.values());
        assert!(compare_rays(&both, &occupancy, &mut rng) > 50);
    }
    let (mut learns, values) = (vec![false; fine.len()], both.bricks.values().to_dense());
    active.iter().for_each(|node| learns[node] = true);
    let held = (0..fine.len()).filter(|&node| !learns[node] && fine.position(node).length() < 0.4).count();
    assert!(held > 50, "{held} nodes");
    assert!((0..fine.len()).all(|node| learns[node] || values[node] == base[node]));
}
