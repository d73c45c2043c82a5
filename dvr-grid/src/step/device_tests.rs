//! What the processor does in a step, a graphics processor does. Skipped, with a line of output, where no driver offers
//! one; a software adapter will do.

use burn::tensor::Device;
use dvr_core::View;
use dvr_core::hull::MaskDistance;
use dvr_core::voxel::VoxelGrid;
use dvr_test_support::relative_difference;
use glam::{DVec3, Vec3};

use super::*;
use crate::GridLosses;
use crate::clock::PartTimes;
use crate::start::hull_start;
use crate::step::CpuBackend;
use crate::step::rays::tests::view;
use crate::views::PixelOrder;
use dvr_core::Supervision;

const RAYS: usize = 600;

fn gpu() -> Option<Device> {
    dvr_test_support::gpu(dvr_gpu::open(0)).map(|gpu| gpu.device)
}

/// A painted ball from ten sides, which looks a little different from two neighbouring ones.
fn views() -> Vec<View> {
    let eye = |i: usize| {
        let (turn, height) = (0.55 * i as f64, 0.7 * (0.9 * i as f64).sin());
        DVec3::new(1.5 * turn.sin(), height, -1.5 * turn.cos())
    };
    let mut views: Vec<View> = (0..10).map(|i| view(eye(i))).collect();
    // Depth maps have gaps.
    for depth in views.iter_mut().filter_map(|view| view.depth.as_mut()) {
        depth.z_depth.iter_mut().step_by(7).for_each(|z_depth| *z_depth = f32::NAN);
    }
    views
}

/// All losses at once.
fn config() -> GridConfig {
    GridConfig {
        rays: RAYS,
        // One more than there are neighbours.
        compared_views: 3,
        losses: GridLosses { depth: 5.0, texture: 0.5, photo_consistency_limit: 3.0, ..GridLosses::default() },
        ..GridConfig::new(Supervision::RgbDepth)
    }
}

/// The ball's hull on grids of three levels of shape and two of colour.
struct Fixture {
    config: GridConfig,
    packed: Vec<TrainingView<'static>>,
    order: PixelOrder,
    shape: MultiResGrid<1>,
    color: MultiResGrid<3>,
    rays_drawn: u64,
    is_reported: bool,
}

impl Fixture {
    /// With this much noise on its distances, in spacings: rays then cross the surface many times.
    fn new(noise: f32) -> Self {
        let views: &'static [View] = views().leak();
        let references: Vec<&View> = views.iter().collect();
        let masks: Vec<MaskDistance> = views
            .iter()
            .filter_map(View::training_pair)
            .map(|(camera, mask)| MaskDistance::new(camera, mask))
            .collect();
        let grid = VoxelGrid::new(33, 0.55);
        let (mut base, active) = hull_start(&masks, &grid, 0, None);
        for node in active.iter() {
            base[node] += noise * grid.spacing() * (mix(node as u64) as f32 / u64::MAX as f32 - 0.5);
        }
        let shape = MultiResGrid::new(active, base, 2);
        let colored = shape.active().coarser();
        let gray = vec![0.5; 3 * colored.grid().len()];
        Self {
            config: config(),
            packed: TrainingView::pack(&references, 2),
            order: PixelOrder::new(&references, &masks, |_| 6.0),
            shape,
            color: MultiResGrid::new(colored, gray, 1),
            rays_drawn: 0,
            is_reported: true,
        }
    }

    fn job<'a>(&'a self, times: &'a mut PartTimes) -> StepInput<'a> {
        StepInput {
            config: &self.config,
            views: &self.packed,
            order: &self.order,
            rays_drawn: self.rays_drawn,
            mean_color: [0.4, 0.5, 0.6],
            decay: 1.0,
            is_reported: self.is_reported,
            times,
        }
    }

    /// Steps, which change the levels where the backend does not keep them to itself.
    fn steps(&mut self, backend: &mut dyn StepBackend, steps: usize) -> Option<StepSums> {
        let mut sums = None;
        for _ in 0..steps {
            let (mut shape, mut color) = (self.shape.clone(), self.color.clone());
            sums = backend.step(self.job(&mut PartTimes::default()), &mut shape, &mut color).unwrap();
            (self.shape, self.color) = (shape, color);
            self.rays_drawn += RAYS as u64;
        }
        sums
    }

    fn device(&self, device: &Device) -> GpuBackend {
        let mut backend = GpuBackend::new(device, &self.packed, &self.config).unwrap();
        backend.enter(&self.shape, &self.color).unwrap();
        backend
    }

    /// The gradients that the last step on the processor left at the active nodes.
    fn gradients(&mut self) -> [Vec<f32>; 2] {
        let (_, gradient, active) = self.shape.values_and_gradient_mut();
        let shape = active.iter().map(|node| gradient[node]).collect();
        let (_, gradient, active) = self.color.values_and_gradient_mut();
        [shape, active.iter().flat_map(|node| &gradient[3 * node..3 * node + 3]).copied().collect()]
    }
}

/// A ray_gradient of the processor as the device writes it down.
fn row(backend: &CpuBackend, fixture: &Fixture, ray: usize) -> [f32; RAY_GRADIENT_COLUMNS] {
    let (mut times, mut sums) = (PartTimes::default(), LossSums::default());
    let job = fixture.job(&mut times);
    let scene = backend.scene(&job, &fixture.shape, &fixture.color);
    let count = fixture.rays_drawn + ray as u64;
    let (view, index) = fixture.order.pick(count, 0);
    let pixel = fixture.packed[view as usize].pixel_ray(view, index);
    let ray_gradient = scene.ray_gradient(&pixel, mix(mix(count)), &mut sums);
    let mut row = [0.0; RAY_GRADIENT_COLUMNS];
    if let Some(ray_gradient) = ray_gradient {
        let grid = fixture.shape.grid();
        let point = grid.position(ray_gradient.shape_cell.node) + ray_gradient.shape_cell.at * grid.spacing();
        let parts = [point, ray_gradient.grad_color].map(|v: Vec3| v.to_array());
        row[..3].copy_from_slice(&parts[0]);
        row[3] = ray_gradient.grad_value;
        row[4..7].copy_from_slice(&parts[1]);
    }
    let losses = [sums.color, sums.photo_consistency, sums.patch_ncc, sums.depth, sums.mask];
    (0..5).for_each(|i| row[7 + i] = losses[i] as f32);
    (row[12], row[13]) = (sums.intersection as f32, sums.union as f32);
    row
}

#[test]
fn a_step_teaches_and_moves_what_it_does_on_the_processor() {
    let Some(device) = gpu() else { return };
    for noise in [0.0, 3.0] {
        println!("noise of {noise} spacings");
        compare_a_step(Fixture::new(noise), &device);
    }
}

fn compare_a_step(mut fixture: Fixture, device: &Device) {
    // Away from the start, where much is zero.
    let mut on_cpu = CpuBackend::new(&fixture.shape, &fixture.color);
    fixture.steps(&mut on_cpu, 3);
    let mut on_gpu = fixture.device(device);
    let rows: Vec<_> = (0..RAYS).map(|ray| row(&on_cpu, &fixture, ray)).collect();
    let largest: [f32; RAY_GRADIENT_COLUMNS] =
        std::array::from_fn(|i| rows.iter().fold(0.0f32, |most, row| most.max(row[i].abs())));
    println!("largest {largest:.3?}");
    assert!(largest.iter().all(|&most| most > 0.0), "all losses teach: {largest:?}");

    let before = on_gpu.levels().unwrap().unwrap();
    assert_eq!(before, (fixture.shape.state(), fixture.color.state()), "what is brought there is there");
    let our_sums = fixture.steps(&mut on_gpu, 1).unwrap();
    let ray_gradients = on_gpu.trainer().sums().unwrap().ray_gradients;
    let (mut unlike, mut farthest) = (0, [0.0f32; RAY_GRADIENT_COLUMNS]);
    for (ours, truth) in ray_gradients.as_chunks::<RAY_GRADIENT_COLUMNS>().0.iter().zip(&rows) {
        let off: [f32; RAY_GRADIENT_COLUMNS] = std::array::from_fn(|i| (ours[i] - truth[i]).abs() / largest[i]);
        // Where something lies on a border to rounding, either side is right.
        if off.iter().any(|&off| off > 2e-4) {
            println!("{ours:?}\n{truth:?}\n");
            unlike += 1;
        } else {
            farthest = std::array::from_fn(|i| farthest[i].max(off[i]));
        }
    }
    println!(
        "{unlike} of {RAYS} rays are unlike, the others at most {} apart, of the largest",
        farthest.map(|x| format!("{x:.0e}")).join(" ")
    );
    assert!(unlike <= RAYS / 100, "{unlike} rays");

    fixture.rays_drawn -= RAYS as u64;
    let sums = fixture.steps(&mut on_cpu, 1).unwrap();
    println!("{our_sums:?}\n{sums:?}");
    let close = |ours: f64, truth: f64| (ours - truth).abs() < 5e-3 * truth.abs();
    assert!(close(our_sums.rays.color, sums.rays.color) && close(our_sums.rays.patch_ncc, sums.rays.patch_ncc));
    assert!(close(our_sums.smoothness.into(), sums.smoothness.into()));
    let gradients = on_gpu.trainer().gradients().unwrap();
    let truth = fixture.gradients();
    let gradients_apart = [0, 1].map(|i| relative_difference(&gradients[i], &truth[i]));
    let (shape, color) = on_gpu.levels().unwrap().unwrap();
    let levels_apart =
        [relative_difference(&shape, &fixture.shape.state()), relative_difference(&color, &fixture.color.state())];
    println!("gradients {gradients_apart:?} apart, parameters and moments {levels_apart:?}");
    assert!(gradients_apart.iter().all(|&apart| apart < if unlike == 0 { 1e-3 } else { 0.1 }), "{gradients_apart:?}");
    assert!(levels_apart.iter().all(|&apart| apart < if unlike == 0 { 1e-3 } else { 0.1 }), "{levels_apart:?}");
}

#[test]
fn nothing_is_waited_for_unless_somebody_looks() {
    let Some(device) = gpu() else { return };
    let mut fixture = Fixture::new(0.0);
    let mut backend = fixture.device(&device);
    fixture.is_reported = false;
    assert!(fixture.steps(&mut backend, 12).is_none());
    assert_eq!(backend.trainer().reads(), 0);
    fixture.is_reported = true;
    assert!(fixture.steps(&mut backend, 1).is_some());
    assert_eq!(backend.trainer().reads(), 1, "the losses of a step, at once");
    backend.levels().unwrap();
    assert_eq!(backend.trainer().reads(), 3, "the levels of shape and of colour");
}

#[test]
fn steps_give_the_same_bits_twice_and_after_a_break() {
    let Some(device) = gpu() else { return };
    let after = |breaks: bool| {
        let mut fixture = Fixture::new(0.0);
        let mut backend = fixture.device(&device);
        fixture.steps(&mut backend, 3);
        if breaks {
            let (shape, color) = backend.levels().unwrap().unwrap();
            assert!(fixture.shape.restore(&shape) && fixture.color.restore(&color));
            backend = fixture.device(&device);
        }
        fixture.steps(&mut backend, 3);
        backend.levels().unwrap().unwrap()
    };
    let bits = |(shape, color): (Vec<f32>, Vec<f32>)| {
        [shape, color].concat().into_iter().map(f32::to_bits).collect::<Vec<_>>()
    };
    let unbroken = bits(after(false));
    assert_eq!(unbroken, bits(after(false)), "twice");
    assert_eq!(unbroken, bits(after(true)), "after a break");
}
