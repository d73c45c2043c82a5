//! The grid method on a GPU: results near the CPU's, and runs that resume on either.
//!
//! Runs on the first adapter; a software adapter will do.

use std::sync::OnceLock;

use burn::tensor::Device;
use dvr_core::mesh::shapes;
use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, ViewSplit};
use dvr_core::{Ray, Scene};
use dvr_grid::{Capacity, GridConfig, GridTrainer, TrainerState};
use dvr_grid::{GpuGridField, GridField, GridValues};
use dvr_render::Shader;
use dvr_render::extract::ScalarField;
use dvr_tests::{gpu, largest, max_difference, rendered_scene, test_with};
use glam::{DVec3, Vec3};

/// A ring, seen from twelve sides.
fn ring() -> &'static Scene {
    static RING: OnceLock<Scene> = OnceLock::new();
    RING.get_or_init(|| {
        let mut scene = rendered_scene(shapes::torus(1.0, 0.45, 32, 16), 12, 32);
        scene.hold_out(4);
        scene
    })
}

/// A stage of 16 cells, trained as a whole, and one of 32, trained near the surface.
fn trainer(device: &Device, seed: u64, steps: usize) -> GridTrainer<'static> {
    let config = GridConfig {
        seed,
        steps,
        rays: 256,
        first_cells: 16,
        whole_cells: 16,
        color_coarseness: 1,
        capacity: Capacity::Cells(32),
        ..GridConfig::default()
    };
    let views = ViewSplit::of(ring()).unwrap();
    GridTrainer::start_on(device, views.train, views.validation, config, &Cancellation::default()).unwrap()
}

/// PSNR and silhouettes of validation views, and the loss, after training.
fn trained(device: &Device, seed: u64) -> [f64; 3] {
    let mut trainer = trainer(device, seed, 60);
    let mut loss = 0.0;
    while trainer.steps_done() < trainer.total_steps() {
        loss = trainer.step().unwrap().loss;
    }
    let found = trainer.validate(8192).expect("views validate");
    [found.psnr, found.mask_iou, loss]
}

#[test_with(gpu)]
fn training_ends_near_the_cpu() {
    let gpu = gpu();
    let on_cpu: Vec<[f64; 3]> = (0..3).map(|seed| trained(&Device::flex(), seed)).collect();
    let on_gpu = trained(&gpu, 0);
    println!("PSNR, IoU, loss: {on_gpu:.4?}; on the CPU with three seeds {on_cpu:.4?}");
    for (figure, least) in [(0, 0.05), (1, 0.002), (2, 0.005)] {
        let of_seeds = on_cpu.iter().map(|found| found[figure]);
        let spread = of_seeds.clone().fold(f64::NEG_INFINITY, f64::max) - of_seeds.fold(f64::INFINITY, f64::min);
        let off = (on_gpu[figure] - on_cpu[0][figure]).abs();
        assert!(off <= spread.max(least), "figure {figure}: {on_gpu:?}, on the CPU {on_cpu:?}");
    }
}

fn bits(state: &TrainerState) -> (&[u8], &[u8]) {
    (&state.model, &state.training)
}

#[test_with(gpu)]
fn a_run_resumes_bit_for_bit_on_the_gpu_and_closely_on_the_cpu() {
    let gpu = gpu();
    let steps = 8;
    let mut unbroken = trainer(&gpu, 0, steps);
    let (mut states, mut losses) = (Vec::new(), Vec::new());
    for _ in 0..2 * steps {
        losses.push(unbroken.step().unwrap().loss);
        states.push(unbroken.state().unwrap());
    }
    // Losses are read in the first step, in every tenth, and at the end of a stage.
    losses.dedup();
    assert_eq!(losses.len(), 4, "{losses:?}");
    let resumed_at = |device: &Device, done: usize| {
        let mut resumed = trainer(device, 0, steps);
        resumed.resume(&states[done - 1], done).unwrap();
        (done..2 * steps).for_each(|_| drop(resumed.step().unwrap()));
        (resumed.state().unwrap(), resumed.validate(4096).expect("views validate"))
    };
    let truth = unbroken.validate(4096).expect("views validate");
    // In the first stage, at its end, and in the second.
    for done in [3, 8, 13] {
        let (state, _) = resumed_at(&gpu, done);
        assert!(bits(&state) == bits(&states[2 * steps - 1]), "from step {done}, bit for bit");
        let (_, found) = resumed_at(&Device::flex(), done);
        println!("from step {done} on the CPU: {:.4} dB, on the GPU {:.4}", found.psnr, truth.psnr);
        assert!((found.psnr - truth.psnr).abs() < 0.1 && (found.mask_iou - truth.mask_iou).abs() < 0.01);
    }
}

/// Waves around a ball, coloured by place, also beyond what can be shown.
fn waves() -> GridField {
    let (shape, color) = (VoxelGrid::new(34, 0.55), VoxelGrid::new(12, 0.55));
    let logit = |node| {
        let p = shape.position(node);
        0.3 - p.length() + 0.04 * (20.0 * p.x).sin() * (17.0 * p.y).cos() * (23.0 * p.z).sin()
    };
    let values = (0..shape.len()).map(logit).collect();
    let colors = (0..color.len()).flat_map(|node| (3.0 * color.position(node) + 0.5).to_array()).collect();
    GridField::new(GridValues { grid: shape, values }, GridValues { grid: color, values: colors })
}

/// Points spread over a ball of radius 0.9: some in the cube, some beyond.
fn points(count: usize) -> Vec<Vec3> {
    let spread = |i: usize, by: f64| (i as f64 * by).fract();
    let point = |i| {
        let (height, turn) = (2.0 * spread(i, 0.618_034) - 1.0, std::f64::consts::TAU * spread(i, 0.754_878));
        let around = (1.0 - height * height).sqrt();
        0.9 * spread(i, 0.569_84).cbrt() * DVec3::new(around * turn.cos(), around * turn.sin(), height)
    };
    (0..count).map(|i| point(i).as_vec3()).collect()
}

#[test_with(gpu)]
fn a_field_is_the_same_on_the_gpu() {
    let gpu = gpu();
    let here = waves();
    let there = GpuGridField::new(here.clone(), &gpu).unwrap();

    let points = points(3000);
    let farthest = |a: &[[f32; 3]], b: &[[f32; 3]]| max_difference(a.as_flattened(), b.as_flattened());
    assert!(max_difference(&here.logits(&points), &there.logits(&points)) < 1e-6);
    let colors = [&here as &dyn ScalarField, &there].map(|field| field.colors(&points, &points, None).unwrap());
    assert!(farthest(&colors[0], &colors[1]) < 1e-5);
    assert!(colors[1].as_flattened().contains(&0.0), "clamped");
    let gradients = [&here as &dyn ScalarField, &there].map(|field| field.gradients(&points).unwrap());
    assert_eq!(gradients[0].len(), gradients[1].len());
    let apart = largest(gradients[0].iter().zip(&gradients[1]).map(|(a, b)| a.distance(*b)));
    assert!(apart < 1e-4, "{apart}");

    // From outside and from within, aslant and along the axes, to the object and past it.
    let ends = points.chunks_exact(2).map(|pair| (pair[0].as_dvec3(), pair[1].as_dvec3()));
    let mut rays: Vec<Ray> = ends.map(|(origin, end)| Ray { origin, direction: 2.0 * (end - origin) }).collect();
    rays.extend(
        points[..300].iter().map(|p| Ray { origin: DVec3::new(p.x.into(), p.y.into(), -2.0), direction: DVec3::Z }),
    );
    let (mut hits, mut misses, mut odd) = (0, 0, 0);
    for (a, b) in here.shade(&rays).into_iter().zip(there.shade(&rays)) {
        match (a, b) {
            (Some(a), Some(b)) => {
                hits += 1;
                let normals_apart = Vec3::from(a.normal).distance(b.normal.into());
                let same = (a.depth - b.depth).abs() < 1e-5 && farthest(&[a.color], &[b.color]) < 1e-4;
                odd += usize::from(!same || normals_apart > 1e-3);
            }
            (None, None) => misses += 1,
            _ => odd += 1,
        }
    }
    assert!(hits > 150 && misses > 150, "{hits} hits, {misses} misses");
    assert!(odd <= 3, "{odd} rays differ, more than those that graze");
    assert!(there.shade(&[]).is_empty());
}
