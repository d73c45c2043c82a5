//! A field does not depend on threads or on interruptions, and colours count as far as views agree.

use std::path::Path;

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};

use super::*;
use crate::Capacity;

/// A small scene of a torus.
fn scene(folder: &Path) -> dvr_core::Scene {
    let torus = TexturedMesh { mesh: shapes::torus(1.0, 0.45, 32, 16), ..TexturedMesh::default() };
    let few = SynthConfig { views: 8, width: 32, height: 32, ..SynthConfig::default() };
    render_dataset(&torus, "torus", "rings", folder, &few, &|_, _| ()).unwrap();
    read_scene(&folder.join("rings/torus"), &ReadOptions::default()).unwrap()
}

#[test]
fn a_field_does_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let field = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let config = GridConfig { steps: 20, capacity: Capacity::Cells(64), ..GridConfig::default() };
            let mut trainer = GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).unwrap();
            while trainer.steps_done() < trainer.total_steps() {
                trainer.step().unwrap();
            }
            trainer.state().unwrap()
        })
    };
    let (one, three) = (field(1), field(3));
    assert!(one.model == three.model && one.training == three.training, "bit for bit");
}

#[test]
fn a_run_goes_on_from_any_step_as_if_it_had_not_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    // Stages of 8 cells, which learn as a whole, and of 16, 32 and 64, which learn near the surface.
    let config = GridConfig {
        steps: 3,
        first_cells: 8,
        whole_cells: 8,
        coarsest_cells: 4,
        color_coarseness: 1,
        capacity: Capacity::Cells(64),
        ..GridConfig::default()
    };
    let start = || GridTrainer::new(scene.views.iter().collect(), Vec::new(), config.clone()).unwrap();
    let mut unbroken = start();
    let mut states = Vec::new();
    for _ in 0..12 {
        unbroken.step().unwrap();
        states.push(unbroken.state().unwrap());
    }
    let last = &states[11];
    for (done, state) in states.iter().enumerate().map(|(i, state)| (i + 1, state)) {
        let mut resumed = start();
        resumed.resume(state, done).unwrap();
        (done..12).for_each(|_| drop(resumed.step().unwrap()));
        let end = resumed.state().unwrap();
        assert!(end.model == last.model && end.training == last.training, "from step {done}, bit for bit");
    }
}

#[test]
fn a_state_of_more_cells_than_its_configuration_allows_is_refused_before_they_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let config = GridConfig { steps: 4, capacity: Capacity::Cells(32), ..GridConfig::default() };
    let mut trainer = GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).unwrap();
    let sound = trainer.state().unwrap();
    let progress = state::Progress { cells: 1 << 20, ..state::progress(&sound.training).unwrap() };
    let training = state::to_bytes(&progress, &trainer.backend.grids().unwrap(), None).unwrap();
    assert!(trainer.resume(&TrainerState { training, ..sound.clone() }, 0).is_err());
    trainer.resume(&sound, 0).unwrap();
}

/// The same scene with the brightness of each view multiplied by what `gain` says.
fn exposed(folder: &Path, gain: impl Fn(usize) -> f32) -> dvr_core::Scene {
    let mut scene = scene(folder);
    for (i, view) in scene.views.iter_mut().enumerate() {
        let scaled = view.image.pixels().flat_map(|pixel| pixel.0.map(|value| (f32::from(value) * gain(i)) as u8));
        let (width, height) = view.image.dimensions();
        view.image = dvr_core::stored(image::RgbImage::from_raw(width, height, scaled.collect()).unwrap());
    }
    scene
}

/// Half of the views darker.
fn alternating(view: usize) -> f32 {
    if view.is_multiple_of(2) { 1.0 } else { 0.6 }
}

/// Trust in colours after some steps, and the exposures found.
fn trust(gain: impl Fn(usize) -> f32, exposure: ExposureCorrection) -> (f64, Vec<Exposure>) {
    let folder = tempfile::tempdir().unwrap();
    let scene = exposed(folder.path(), gain);
    let config = GridConfig { steps: 151, exposure, ..GridConfig::default() };
    let mut trainer = GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).unwrap();
    (0..151).for_each(|_| drop(trainer.step().unwrap()));
    (trainer.color_trust, trainer.exposures)
}

#[test]
fn colours_shape_the_surface_where_views_agree_on_them_and_not_where_exposure_changes() {
    use ExposureCorrection::{Auto, Off};
    assert_eq!(trust(|_| 1.0, Auto), (1.0, Vec::new()));
    assert_eq!(trust(alternating, Off), (0.0, Vec::new()));
    let (trusted, exposures) = trust(alternating, Auto);
    assert!(trusted > 0.5, "corrected colours agree: {trusted}");
    let stops = |view: usize| Exposure::stops(exposures[view].logs()[1]);
    // A factor of .6 of sRGB is one of the light above the toe only: 1.3 stops at .2, 1.7 at .8.
    let apart = stops(1) - stops(0);
    assert!((1.2..1.8).contains(&apart), "{apart}");
}

#[test]
fn a_run_whose_exposures_are_corrected_goes_on_as_if_it_had_not_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let scene = exposed(folder.path(), alternating);
    let views = || scene.views.iter().collect::<Vec<_>>();
    let config = GridConfig { steps: 120, capacity: Capacity::Cells(32), ..GridConfig::default() };
    let start = || GridTrainer::new(views()[1..].to_vec(), views()[..1].to_vec(), config.clone()).unwrap();
    let (mut unbroken, mut states) = (start(), Vec::new());
    for _ in 0..120 {
        unbroken.step().unwrap();
        states.push(unbroken.state().unwrap());
    }
    assert!(!unbroken.exposures().is_empty() && unbroken.notes().iter().any(|note| note.contains("stops")));
    for done in [1, 60, 100, 119] {
        let mut resumed = start();
        resumed.resume(&states[done - 1], done).unwrap();
        (done..120).for_each(|_| drop(resumed.step().unwrap()));
        assert!(resumed.state().unwrap().training == states[119].training, "from step {done}, bit for bit");
    }
    let mut other = GridTrainer::new(views(), Vec::new(), config.clone()).unwrap();
    assert!(other.resume(&states[60], 61).is_err(), "exposures of other views");
}
