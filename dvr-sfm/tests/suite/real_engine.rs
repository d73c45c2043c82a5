//! COLMAP itself, where it is installed: rendered photographs, whose cameras are known.

use crate::support::{cameras_of_turntable, photograph, photograph_of_turntable, true_cameras, write_photographs};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::{Camera, Scene};
use dvr_sfm::{CameraErrors, SfmOptions, Source, find_cameras};
use dvr_test_support::{program, test_with};

/// Cameras of a scene by the numbers of their pictures, in its own world.
fn cameras(scene: &Scene) -> Vec<(usize, Camera)> {
    let world = |camera: &Camera| camera.into_world(&scene.object_to_world);
    scene.views.iter().map(|view| (view.name.parse().unwrap(), world(&view.camera))).collect()
}

/// Degrees, and the share of the distance, by which cameras are off at most.
fn largest_errors(scene: &Scene, truth: &[Camera]) -> (f64, f64) {
    let (numbers, found): (Vec<usize>, Vec<Camera>) = cameras(scene).into_iter().unzip();
    let truth: Vec<Camera> = numbers.iter().map(|&number| truth[number].clone()).collect();
    let errors = CameraErrors::between(&found, &truth).unwrap();
    let largest = |values: &[f64]| values.iter().fold(0.0f64, |a, &b| a.max(b.abs()));
    (largest(&errors.rotation_degrees), largest(&errors.center_share))
}

#[test_with(colmap)]
fn rendered_photographs_get_their_true_cameras_and_pictures_of_something_else_none() {
    let parent = tempfile::tempdir().unwrap();
    let (photos, out) = (parent.path().join("photos"), parent.path().join("found"));
    let truth = true_cameras(16);
    write_photographs(&photos, &truth, photograph);
    // One that shows the floor from inside it: a plain colour.
    let mut elsewhere = truth[0].clone();
    elsewhere.translation.y += 100.0;
    dvr_core::files::write_jpeg(&photos.join("0099.jpg"), &photograph(&elsewhere), 95, None).unwrap();

    let program = Some(program("colmap"));
    let source = Source::at(&photos).unwrap().unwrap();
    let options = SfmOptions { program, threads: Some(2), ..SfmOptions::default() };
    let mut events = Vec::new();
    let found = find_cameras(&source, &out, &options, &mut |event| events.push(event)).unwrap();
    assert_eq!((found.placed, &found.not_placed[..]), (16, &["0099.jpg".to_owned()][..]), "{found:?}");
    assert!(found.mean_error_px < 1.0 && found.points > 300, "{found:?}");

    for (path, format) in [(out.join("sparse/0"), "COLMAP"), (out.clone(), "NeRF transforms")] {
        let scene = read_scene(&path, &ReadOptions::default()).unwrap();
        assert_eq!(scene.format, format);
        let (degrees, share) = largest_errors(&scene, &truth);
        assert!(degrees < 0.3 && share < 0.01, "{degrees} degrees, {share} of the distance");
    }

    // Found once, they are there.
    let mut again = Vec::new();
    let second = find_cameras(&source, &out, &options, &mut |event| again.push(event)).unwrap();
    assert!(again.is_empty() && second == found);
}

#[test_with(colmap)]
fn an_object_on_a_turntable_is_not_placed_by_the_room_behind_it() {
    let parent = tempfile::tempdir().unwrap();
    let (photos, out) = (parent.path().join("photos"), parent.path().join("found"));
    let truth = cameras_of_turntable(24);
    write_photographs(&photos, &truth, photograph_of_turntable);
    let source = Source::at(&photos).unwrap().unwrap();
    let options = SfmOptions { program: Some(program("colmap")), threads: Some(2), ..SfmOptions::default() };
    let found = find_cameras(&source, &out, &options, &mut |_| ()).unwrap();
    assert!(found.not_placed.is_empty(), "{found:?}");
    assert!(found.notes.iter().any(|note| note.contains("stands still while the object turns")), "{found:?}");
    let (degrees, share) = largest_errors(&read_scene(&out, &ReadOptions::default()).unwrap(), &truth);
    assert!(degrees < 1.5 && share < 0.03, "{degrees} degrees, {share} of the distance");
}
