//! Where the time of a step of the grid method goes: `cargo bench -p dvr-grid --bench step [-- [--steps N] SCENE...]`.
//!
//! Prints a table for grids of 64 to 512 cells: milliseconds per step of each part, and beside what streams
//! through memory the number of passes over the parameters (each read and written once) that would take as long at
//! the bandwidth measured here. The last two columns are rates of one thread: rays whose exact crossing is found, and samples
//! of patches that are compared with another photograph, in millions per second.

use std::path::{Path, PathBuf};
use std::time::Instant;

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::{Scene, Split};
use dvr_grid::{Capacity, GridConfig, GridTrainer, Part, Rates};
use rayon::prelude::*;

/// Steps whose rays the rates are measured with.
const RATED_STEPS: usize = 30;

/// Steps of each stage, where nothing else is asked for; those of the last are measured.
const STEPS: usize = 100;

fn main() {
    let (mut scenes, mut steps) = (Vec::new(), STEPS);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--steps" {
            steps = arguments.next().and_then(|steps| steps.parse().ok()).expect("--steps has a number");
        } else if !argument.starts_with('-') {
            scenes.push(PathBuf::from(argument));
        }
    }
    if scenes.is_empty() {
        scenes.push(Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/mug/mug"));
    }
    let threads = rayon::current_num_threads();
    let bandwidth = bandwidth();
    println!("{threads} threads, {:.1} GB/s read and written\n", bandwidth / 1e9);
    println!(
        "| scene | cells | parameters | step, ms | rays | gather | smoothness | levels | occupancy bitmask | crossings, M/s | patch samples, M/s | surface at the border, % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for path in &scenes {
        let scene = read_scene(path, &ReadOptions::default()).expect("the scene is readable");
        [64, 128, 256, 512].into_iter().for_each(|cells| profile(&scene, cells, steps, bandwidth));
    }
}

fn profile(scene: &Scene, cells: usize, steps: usize, bandwidth: f64) {
    let config = GridConfig { capacity: Capacity::Cells(cells), steps, ..GridConfig::default() };
    let mut trainer = GridTrainer::new(scene.views_of(Split::Train).collect(), Vec::new(), config)
        .expect("the masks show the object");
    while trainer.steps_done() < trainer.total_steps() - steps {
        trainer.step().expect("the loss is finite");
    }
    let before = *trainer.times();
    let parameters = trainer.parameters();
    while trainer.steps_done() < trainer.total_steps() {
        trainer.step().expect("the loss is finite");
    }
    let seconds = Part::ALL.map(|part| (trainer.times().of(part) - before.of(part)).as_secs_f64() / steps as f64);
    // A parameter is four bytes, read and written.
    let pass = 8.0 * parameters as f64 / bandwidth;
    let Rates { crossings, patch_samples } = trainer.rates(RATED_STEPS).expect("the field is in memory");
    let at_border = trainer.surface_at_border().expect("the field is in memory");
    let [rays, gather, smoothness, levels, occupancy] = seconds;
    let streamed = |seconds: f64| format!("{:.2} ({:.1} passes)", 1e3 * seconds, seconds / pass);
    println!(
        "| {} | {cells} | {parameters} | {:.2} | {:.2} | {:.2} | {} | {} | {} | {:.2} | {:.1} | {:.2} |",
        scene.name,
        1e3 * seconds.iter().sum::<f64>(),
        1e3 * rays,
        1e3 * gather,
        streamed(smoothness),
        streamed(levels),
        streamed(occupancy),
        1e-6 * crossings,
        1e-6 * patch_samples,
        1e2 * at_border,
    );
}

/// Bytes that all threads together read and write in a second, of arrays far larger than the caches.
fn bandwidth() -> f64 {
    const WORDS: usize = 32 << 20;
    let source = vec![1_u32; WORDS];
    let mut target = vec![0_u32; WORDS];
    let best = (0..5)
        .map(|_| {
            let start = Instant::now();
            target
                .par_chunks_mut(1 << 16)
                .zip(source.par_chunks(1 << 16))
                .for_each(|(to, from)| to.copy_from_slice(from));
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    (2 * 4 * WORDS) as f64 / best
}
