//! Nothing is learned from test views, and nothing chosen by them; choices go by validation views.

use burn::tensor::Device;
use dvr_core::mesh::shapes;
use dvr_core::{Cancellation, Scene, Split};
use dvr_tests::rendered_scene;
use dvr_train::{
    GridConfig, MeshOptions, Method, RunFolder, RunMetrics, RunOptions, Supervision, Trained, finish, method_by_name,
    refine_cameras, train,
};
use serde_json::json;

/// A ring from twenty sides, its views divided.
fn ring() -> Scene {
    let mut scene = rendered_scene(shapes::torus(1.0, 0.45, 32, 16), 20, 32);
    scene.hold_out(8);
    scene
}

/// The same with pictures and masks of a part turned into their negatives.
fn spoiled(scene: &Scene, part: Split) -> Scene {
    let mut spoiled = scene.clone();
    for view in spoiled.views.iter_mut().filter(|view| view.split == part) {
        view.image.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|channel| 255 - channel));
        if let Some(mask) = &mut view.mask {
            mask.coverage.pixels_mut().for_each(|pixel| pixel.0 = [255 - pixel.0[0]]);
        }
    }
    spoiled
}

/// Trains, and takes the final figures.
fn trained(scene: &Scene, method: &dyn Method) -> (Trained, RunMetrics) {
    let (folder, mut scene) = (tempfile::tempdir().unwrap(), scene.clone());
    let run = RunFolder::new(folder.path().join("run"));
    let _writing = run.create().unwrap();
    let options = RunOptions::new(run.clone(), Device::flex());
    let trained = train(&mut scene, method, None, &options, &mut ()).unwrap();
    let results = finish(&scene, method, &trained, &run, &MeshOptions::with_resolution(24), &mut ()).unwrap();
    (trained, results.metrics)
}

/// A grid that grows from 16 to 64 cells as validation has it.
fn grid() -> Box<dyn Method> {
    let capacity = json!({ "auto": { "min_cells": 16, "max_cells": 64, "min_gain_db": 0.1 } });
    let settings = json!({ "steps": 25, "rays": 256, "first_cells": 16, "color_coarseness": 1, "capacity": capacity });
    method_by_name("grid", Supervision::Rgb).unwrap().overridden(&settings).unwrap()
}

/// A network whose best step is chosen among many.
fn network() -> Box<dyn Method> {
    let settings = json!({
        "steps": 24, "rays": 64, "validate_every": 4, "learning_rate": 0.01,
        "model": { "hidden": 16, "blocks": 1, "octaves": 1 },
        "hull": { "resolution": 32, "warm_start_steps": 20, "warm_start_points": 128 },
    });
    method_by_name("network", Supervision::Rgb).unwrap().overridden(&settings).unwrap()
}

#[test]
fn a_grid_grows_by_validation_views_and_never_by_test_views() {
    let scene = ring();
    let (clean, figures) = trained(&scene, grid().as_ref());
    let (other, other_figures) = trained(&spoiled(&scene, Split::Test), grid().as_ref());
    assert!(clean.outcome.model == other.outcome.model, "bit for bit");
    assert_eq!(clean.outcome.header.notes, other.outcome.header.notes);
    assert_eq!(figures.validation, other_figures.validation);
    assert_ne!(figures.test, other_figures.test);
    let (guided, _) = trained(&spoiled(&scene, Split::Val), grid().as_ref());
    assert_ne!(clean.outcome.header.notes, guided.outcome.header.notes, "validation views are looked at");
}

#[test]
fn the_best_step_of_a_network_goes_by_validation_views_and_the_runs_cost_is_the_runs() {
    let scene = ring();
    let (clean, figures) = trained(&scene, network().as_ref());
    let (other, _) = trained(&spoiled(&scene, Split::Test), network().as_ref());
    assert!(clean.outcome.header.best == other.outcome.header.best && clean.outcome.header.best.is_some());
    // Negatives are matched best by the network that knows least.
    let (guided, guided_figures) = trained(&spoiled(&scene, Split::Val), network().as_ref());
    assert_ne!(clean.outcome.header.best, guided.outcome.header.best, "validation views choose");
    for (figures, trained) in [(figures, clean), (guided_figures, guided)] {
        let best = trained.outcome.header.best.unwrap();
        assert_eq!((figures.steps, figures.model_step), (24, best.step));
        assert!(figures.model_seconds <= figures.training_seconds, "{figures:?}");
        let is_last = figures.model_step == 24;
        assert_eq!(figures.model_seconds < figures.training_seconds, !is_last, "{figures:?}");
    }
}

#[test]
fn cameras_settle_whatever_test_views_show() {
    let scene = ring();
    let config = GridConfig { rays: 256, ..GridConfig::default() };
    let refined =
        |scene: &Scene| refine_cameras(&mut scene.clone(), &config, 1, &Cancellation::default(), &mut ()).unwrap();
    let (clean, other) = (refined(&scene), refined(&spoiled(&scene, Split::Test)));
    assert_eq!((clean.loss, clean.moved_pixels), (other.loss, other.moved_pixels), "bit for bit");
    let mut off = scene.clone();
    off.views[1].camera.translation.x += 0.02;
    assert_eq!(off.views[1].split, Split::Train);
    assert_ne!(clean.moved_pixels, refined(&off).moved_pixels, "training views are looked at");
}
