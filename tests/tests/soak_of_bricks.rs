//! Memory stays as it is while bricks come and go: run after run in one process, each with stages in bands around other surfaces.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use burn::tensor::Device;
use dvr_core::mesh::shapes;
use dvr_core::{Cancellation, Scene, ViewSplit};
use dvr_grid::{Capacity, GridConfig, GridTrainer};
use dvr_tests::{Counted, gpu, rendered_scene, test_with};

#[global_allocator]
static ALLOCATOR: Counted = Counted::new(usize::MAX);

/// Runs that fill what is kept for the next: threads, kernels, pages of a device.
const FIRST: u64 = 2;

/// Runs that show how much is needed, and runs that may not need more.
const MORE: u64 = 4;

/// A stage of 8 cells, trained as a whole, and three of up to 64, trained near the surface, in rays and surfaces of their own.
fn train(scene: &Scene, device: &Device, seed: u64) {
    let config = GridConfig {
        seed,
        steps: 5,
        rays: 256,
        first_cells: 8,
        whole_cells: 8,
        coarsest_cells: 4,
        color_coarseness: 1,
        capacity: Capacity::Cells(64),
        ..GridConfig::default()
    };
    let views = ViewSplit::of(scene).unwrap();
    let mut trainer =
        GridTrainer::start_on(device, views.train, views.validation, config, &Cancellation::default()).unwrap();
    while trainer.steps_done() < trainer.total_steps() {
        trainer.step().unwrap();
    }
}

/// The allocator counts all threads: tests come one after another.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn scenes() -> [Scene; 2] {
    [shapes::torus(1.0, 0.45, 32, 16), shapes::icosphere(2, 1.0)].map(|mesh| rendered_scene(mesh, 8, 32))
}

#[test]
fn runs_on_the_cpu_leave_nothing_behind() {
    let _alone = alone();
    let scenes = scenes();
    let run = |seed: u64| {
        train(&scenes[seed as usize % scenes.len()], &Device::flex(), seed);
        ALLOCATOR.allocated()
    };
    (0..FIRST).map(run).for_each(|_| ());
    let some = |seeds: Range<u64>| {
        ALLOCATOR.forget_peak();
        let left = seeds.map(run).max().unwrap();
        (left, ALLOCATOR.peak())
    };
    let (left, peak) = some(FIRST..FIRST + MORE);
    let (left_later, peak_later) = some(FIRST + MORE..FIRST + 2 * MORE);
    // What a run stores at its end is some hundred kilobytes.
    assert!(left_later < left + 32_000, "{left} bytes are left by some runs, and {left_later} by more");
    assert!(peak_later < peak + peak / 50, "at most {peak} bytes in some runs, and {peak_later} in more");
}

#[test_with(gpu)]
fn runs_on_a_gpu_leave_nothing_behind() {
    let _alone = alone();
    let (scenes, gpu) = (scenes(), gpu());
    let run = |seed: u64| {
        train(&scenes[seed as usize % scenes.len()], &gpu, seed);
        gpu.sync().unwrap();
        dvr_gpu::memory_held(&gpu).expect("the GPU reports it")
    };
    // Pages that are kept differ from run to run.
    let held: Vec<u64> = (0..FIRST + 2 * MORE).map(run).collect();
    let (some, more) = held.split_at((FIRST + MORE) as usize);
    let most = some.iter().max().unwrap();
    assert!(more.iter().all(|held| held <= &(most + most / 50)), "{held:?} bytes after each run");
}
