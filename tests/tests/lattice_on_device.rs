//! The fast method on a graphics processor: what it ends with, and how it goes on elsewhere.
//!
//! Runs on the first adapter that there is, be it a software one; without any the tests say that they were skipped, and
//! pass.

use std::sync::OnceLock;

use burn::tensor::Device;
use dvr_core::Scene;
use dvr_core::mesh::shapes;
use dvr_tests::{graphics_processor, rendered_scene};
use dvr_train::{Capacity, FastConfig, FastTrainer, Learner, LearnerState, ViewSplit};

/// A ring, seen from twelve sides.
fn ring() -> &'static Scene {
    static RING: OnceLock<Scene> = OnceLock::new();
    RING.get_or_init(|| rendered_scene(shapes::torus(1.0, 0.45, 32, 16), 12, 32))
}

/// A stage of 16 cells, taught as a whole, and one of 32, taught near the surface.
fn trainer(device: &Device, seed: u64, steps: usize) -> FastTrainer<'static> {
    let config = FastConfig {
        seed,
        steps,
        rays: 256,
        first_cells: 16,
        whole_cells: 16,
        color_coarseness: 1,
        capacity: Capacity::Cells(32),
        ..FastConfig::default()
    };
    let views = ViewSplit::new(ring(), 4).unwrap();
    FastTrainer::new(views, config).unwrap().on(device).unwrap()
}

/// PSNR and silhouettes of held-out views, and the loss, after training.
fn trained(device: &Device, seed: u64) -> [f64; 3] {
    let mut trainer = trainer(device, seed, 60);
    let mut loss = 0.0;
    while trainer.steps_done() < trainer.total_steps() {
        loss = trainer.step().unwrap().loss;
    }
    let found = trainer.validate(8192).expect("views are held out");
    [found.psnr, found.mask_iou, loss]
}

#[test]
fn training_ends_where_it_ends_on_the_cpu() {
    let Some(gpu) = graphics_processor() else { return };
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

fn bits(state: &LearnerState) -> (&[u8], &[u8]) {
    (&state.model, &state.training)
}

#[test]
fn a_run_goes_on_on_the_device_as_if_it_had_not_stopped_and_on_the_cpu_too() {
    let Some(gpu) = graphics_processor() else { return };
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
    let goes_on = |device: &Device, done: usize| {
        let mut resumed = trainer(device, 0, steps);
        resumed.resume(&states[done - 1], done).unwrap();
        (done..2 * steps).for_each(|_| drop(resumed.step().unwrap()));
        (resumed.state().unwrap(), resumed.validate(4096).expect("views are held out"))
    };
    let truth = unbroken.validate(4096).expect("views are held out");
    // In the first stage, at its end, and in the second.
    for done in [3, 8, 13] {
        let (state, _) = goes_on(&gpu, done);
        assert!(bits(&state) == bits(&states[2 * steps - 1]), "from step {done}, bit for bit");
        let (_, found) = goes_on(&Device::flex(), done);
        println!("from step {done} on the CPU: {:.4} dB, on the device {:.4}", found.psnr, truth.psnr);
        assert!((found.psnr - truth.psnr).abs() < 0.1 && (found.mask_iou - truth.mask_iou).abs() < 0.01);
    }
}
