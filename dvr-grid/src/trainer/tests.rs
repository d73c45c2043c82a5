//! A field does not depend on threads or on interruptions, and colours count as far as views agree.

use std::path::Path;

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{Mesh, TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};

use super::*;
use crate::Capacity;
use crate::report::TrainerState;
use crate::state;

/// A small scene of a torus.
fn scene(folder: &Path) -> dvr_core::Scene {
    rendered(folder, shapes::torus(1.0, 0.45, 32, 16), 32)
}

/// Eight views of a mesh, of so many pixels along an edge.
fn rendered(folder: &Path, mesh: Mesh, side: u32) -> dvr_core::Scene {
    let object = TexturedMesh { mesh, ..TexturedMesh::default() };
    let few = SynthConfig { views: 8, width: side, height: side, ..SynthConfig::default() };
    render_dataset(&object, "object", "shapes", folder, &few, &|_, _| ()).unwrap();
    read_scene(&folder.join("shapes/object"), &ReadOptions::default()).unwrap()
}

#[test]
fn a_field_does_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let field = |threads: usize, whole_cells: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let capacity = Capacity::Cells(64);
            let config = GridConfig { steps: 20, whole_cells, capacity, ..GridConfig::default() };
            let mut trainer = GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).unwrap();
            while trainer.steps_done() < trainer.total_steps() {
                trainer.step().unwrap();
            }
            trainer.state().unwrap()
        })
    };
    // All of the hull learns, or in the last stage a band around the surface.
    for whole_cells in [64, 32] {
        let (one, three) = (field(1, whole_cells), field(3, whole_cells));
        assert!(one.model == three.model && one.training == three.training, "{whole_cells}: bit for bit");
    }
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
fn hollows_that_wait_open_at_their_stage_and_a_run_goes_on_from_any_step() {
    let folder = tempfile::tempdir().unwrap();
    let scene = rendered(folder.path(), shapes::icosphere(3, 1.0), 64);
    let views: Vec<&View> = scene.views.iter().collect();
    // Whole stages of 8, 16 and 32 cells, and one of 64 near the surface. Each must gain what none can.
    let config = GridConfig {
        steps: 3,
        first_cells: 8,
        whole_cells: 32,
        coarsest_cells: 4,
        color_coarseness: 1,
        shape_rate: 1e-4,
        capacity: Capacity::Auto { min_cells: 8, max_cells: 64, min_gain_errors: 1e9, min_gain_db: 1e9 },
        further_passes: 0,
        ..GridConfig::default()
    };
    let cancellation = Cancellation::default();
    // A bore from the middle of the ball to the top, and a hole beside it that the surface does not have.
    let is_bore = |at: glam::Vec3| at.z > -0.1 && at.truncate().length() < 0.2;
    let is_hole = |at: glam::Vec3| at.x > 0.0 && (at.y * at.y + at.z * at.z).sqrt() < 0.08;
    let refinement = || {
        let masks = mask_distances(&views, &cancellation).unwrap();
        // Too few views for stereo and a sweep.
        let whole = || Refinement::new(masks.clone(), &views[..2], &config, None, &cancellation).unwrap();
        let fine = GridConfig { first_cells: 32, ..config.clone() };
        let surface = whole().hollowed(&config, is_bore).first(&fine).unwrap();
        let mut late = whole().hollowed(&config, |at| is_bore(at) || is_hole(at));
        late.carve_from(32, &surface);
        late
    };
    // What was learned before is not taken off walls of the hollow: it was learned of the hull.
    let wall = |learned: f32| {
        let coarse = GridConfig { first_cells: 16, ..config.clone() };
        let mut grids = refinement().first(&coarse).unwrap();
        grids.shape.add_to_finest(&vec![learned; grids.shape.active().count()]);
        refinement().refined(&grids, &config).unwrap().shape.values().value(glam::Vec3::new(0.25, 0.0, 0.1))
    };
    assert!(wall(0.0) > 0.0 && (wall(0.0) - wall(-0.05)).abs() < 1e-3, "{} {}", wall(0.0), wall(-0.05));
    let start = || {
        let views = views.clone();
        GridTrainer::begin(
            views[..6].to_vec(),
            views[6..].to_vec(),
            config.clone(),
            refinement(),
            Vec::new(),
            None,
            &cancellation,
        )
        .unwrap()
    };
    let mut unbroken = start();
    let mut states = Vec::new();
    let mut last_whole = None;
    while !unbroken.finished {
        unbroken.step().unwrap();
        states.push(unbroken.state().unwrap());
        let (cells, field) = (unbroken.backend.grids().unwrap().cells(), unbroken.field().unwrap());
        let at = |x: f32, z: f32| field.logit_at(glam::Vec3::new(x, 0.0, z));
        let (hollow, mouth, hole) = (at(0.0, 0.1), at(0.0, 0.44), at(0.45, 0.0));
        assert_eq!(hollow < 0.0 && mouth < 0.0, cells >= 32, "{cells} cells: {hollow} {mouth}");
        assert!(at(0.0, -0.3) > 0.0 && (cells < 32 || hole > 0.0), "{cells} cells: {hole}");
        if cells < 32 {
            last_whole = Some(field);
        } else if let Some(before) = last_whole.take() {
            // Away from the hollow, opening it moves nothing of what was learned, but for the hull's detail.
            for at in [[-0.4, 0.0, 0.0], [0.0, 0.42, -0.1], [0.2, -0.3, -0.2]].map(glam::Vec3::from) {
                assert!((field.logit_at(at) - before.logit_at(at)).abs() < 0.01, "{at}");
            }
        }
    }
    // That of 64 cells does not gain, and is taken back to one with the hollow.
    assert_eq!((states.len(), unbroken.backend.grids().unwrap().cells()), (12, 32));
    let last = states.last().unwrap();
    for (done, state) in states.iter().enumerate().map(|(i, state)| (i + 1, state)) {
        let mut resumed = start();
        resumed.resume(state, done).unwrap();
        (done..12).for_each(|_| drop(resumed.step().unwrap()));
        let end = resumed.state().unwrap();
        assert!(end.model == last.model && end.training == last.training, "from step {done}, bit for bit");
    }
}

/// A ball whose photographs are noise, dark in one and bright in the next: patches judge, and colours do not agree.
fn noisy(folder: &Path) -> dvr_core::Scene {
    let mut scene = rendered(folder, shapes::icosphere(3, 1.0), 40);
    for (i, view) in scene.views.iter_mut().enumerate() {
        let (width, height) = view.image.dimensions();
        let least = if i.is_multiple_of(2) { 128 } else { 0 };
        let noise = (0..3 * width * height)
            .map(|at| least + (crate::pixel_order::mix(u64::from(at) ^ (i as u64) << 32) % 128) as u8);
        view.image = dvr_core::stored(image::RgbImage::from_raw(width, height, noise.collect()).unwrap());
    }
    scene
}

/// Every view trains but the first, which validates. Two stages of `steps` steps, then as many passes as `errors` allows:
/// the gain that keeps them, in standard errors.
fn with_passes<'a>(scene: &'a dvr_core::Scene, steps: usize, errors: f64) -> GridTrainer<'a> {
    let config = GridConfig {
        steps,
        further_passes: 2,
        further_after_gain: -1.0,
        first_cells: 16,
        whole_cells: 16,
        coarsest_cells: 4,
        capacity: Capacity::Auto { min_cells: 32, max_cells: 32, min_gain_errors: errors, min_gain_db: 0.0 },
        exposure: ExposureCorrection::Off,
        ..GridConfig::default()
    };
    let views: Vec<&View> = scene.views.iter().collect();
    GridTrainer::new(views[1..].to_vec(), views[..1].to_vec(), config).unwrap()
}

#[test]
fn further_passes_follow_while_they_gain_and_the_one_that_does_not_is_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let scene = noisy(folder.path());
    let run = |errors: f64, after_gain: f64| {
        let mut trainer = with_passes(&scene, 10, errors);
        trainer.config.further_after_gain = after_gain;
        let mut grown = None;
        while trainer.steps_done() < trainer.total_steps() {
            trainer.step().unwrap();
            if trainer.steps_done() == 20 {
                grown = Some(trainer.state().unwrap().model);
            }
        }
        let is_taken_back = grown.unwrap() == trainer.state().unwrap().model;
        (trainer.steps_done(), is_taken_back, trainer.notes().join("; "))
    };
    let (steps, is_taken_back, said) = run(-1000.0, -1.0);
    assert!(steps == 40 && !is_taken_back && said.matches("and are kept").count() == 2, "{steps}: {said}");
    let (steps, is_taken_back, said) = run(1000.0, -1.0);
    assert!(steps == 30 && is_taken_back && said.contains("and are not: training ends"), "{steps}: {said}");
    // None follows a stage that gained too little.
    let (steps, _, said) = run(-1000.0, 1.0);
    assert!(steps == 20 && !said.contains("more steps"), "{steps}: {said}");
}

#[test]
fn colours_that_count_in_full_need_no_further_pass() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let mut trainer = with_passes(&scene, 10, -1000.0);
    while trainer.steps_done() < trainer.total_steps() {
        trainer.step().unwrap();
    }
    assert_eq!((trainer.agreement.trust(), trainer.steps_done()), (1.0, 20));
}

#[test]
fn a_further_pass_goes_on_as_if_it_had_not_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let scene = noisy(folder.path());
    for (errors, end) in [(-1000.0, 40), (1000.0, 30)] {
        let (mut unbroken, mut states) = (with_passes(&scene, 10, errors), Vec::new());
        while unbroken.steps_done() < unbroken.total_steps() {
            unbroken.step().unwrap();
            states.push(unbroken.state().unwrap());
        }
        assert_eq!(unbroken.steps_done(), end);
        for done in [19, 20, 21, 25, 29, 30, 31, 39, 40] {
            let Some(state) = states.get(done - 1) else { continue };
            let mut resumed = with_passes(&scene, 10, errors);
            resumed.resume(state, done).unwrap();
            while resumed.steps_done() < resumed.total_steps() {
                resumed.step().unwrap();
            }
            assert_eq!(resumed.steps_done(), end);
            assert!(resumed.state().unwrap().training == states[end - 1].training, "from step {done}, bit for bit");
        }
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
    (trainer.agreement.trust(), trainer.exposures)
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
