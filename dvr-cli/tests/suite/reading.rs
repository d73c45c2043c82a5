//! The options that say how a scene is read: each does what it says, from the command line to the mesh.

use std::path::{Path, PathBuf};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::files::{read_mask, write_gray_png};
use dvr_core::mesh::{Mesh, shapes};
use dvr_core::npz::{Array, NpzFile, write_npz};
use dvr_core::{Camera, Similarity};
use glam::{DMat3, DMat4, DVec3, Vec3};
use image::Luma;

/// Trains with more arguments; returns the run and what was said about it.
fn train(tiny: &Tiny, run: &str, more: &[&str]) -> (PathBuf, String) {
    let (scene, out) = (tiny.scene(), tiny.path(run));
    let start = ["train", text(&scene), "--out", text(&out), "--resolution", "32", "--no-report"];
    let output = dvr(&[&start[..], more].concat());
    let told = succeeds(&output) + &String::from_utf8_lossy(&output.stderr);
    (out, told)
}

/// The views that a run was trained on or judged by, rendered: their names, and the width of the first.
fn views(tiny: &Tiny, run: &Path) -> (Vec<String>, u32) {
    let frames = tiny.path("frames");
    succeeds(&dvr(&["render", text(run), "--out", text(&frames), "--cameras", "dataset", "--samples", "16"]));
    let entries = std::fs::read_dir(&frames).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.filter(|name| name.ends_with(".png")).collect();
    names.sort();
    let width = image::open(frames.join(&names[0])).unwrap().width();
    std::fs::remove_dir_all(frames).unwrap();
    (names, width)
}

#[test]
fn downscaled_pictures_are_half_as_wide_and_show_the_same_object() {
    let tiny = Tiny::rendered(shapes::torus(1.0, 0.45, 32, 16), 12, 48);
    let (run, _) = train(&tiny, "half", &["--method", "hull", "--downscale", "2"]);
    assert_eq!(views(&tiny, &run), ((0..12).map(|i| format!("{i:04}.png")).collect(), 24));
    let iou = tiny.volume_iou(&run.join("mesh.ply"));
    assert!(iou > 0.7, "{iou}");
}

#[test]
fn ignored_views_are_left_out_by_name_and_by_number() {
    let tiny = Tiny::new();
    // A picture that would be refused if it were read.
    std::fs::write(tiny.scene().join("image/0003.png"), "no picture").unwrap();
    let (run, _) = train(&tiny, "run", &["--method", "hull", "--ignore", "0003,7"]);
    let rest = (0..12).filter(|i| ![3, 7].contains(i)).map(|i| format!("{i:04}.png"));
    assert_eq!(views(&tiny, &run).0, rest.collect::<Vec<_>>());
    let (scene, out) = (tiny.scene(), tiny.path("refused"));
    refuses(&dvr(&["train", text(&scene), "--out", text(&out), "--ignore", "0003,12"]), &["12"]);
}

#[test]
fn a_plain_background_makes_the_masks() {
    let tiny = Tiny::new();
    std::fs::remove_dir_all(tiny.scene().join("mask")).unwrap();
    let (scene, out) = (tiny.scene(), tiny.path("refused"));
    refuses(&dvr(&["train", text(&scene), "--out", text(&out), "--masks", "given"]), &["mask", "--background"]);
    assert!(!out.join("config.json").exists(), "nothing half-written");
    let (run, _) = train(&tiny, "run", &["--background", "white", "--steps", "20", "--capacity", "32"]);
    let iou = tiny.volume_iou(&run.join("mesh.ply"));
    assert!(iou > 0.8, "{iou}");
}

#[test]
fn masks_of_another_folder_are_taken_by_the_names_of_views_and_again_for_the_figures() {
    let tiny = Tiny::new();
    let masks = tiny.path("my-masks");
    std::fs::rename(tiny.scene().join("mask"), &masks).unwrap();
    let (run, _) = train(&tiny, "run", &["--method", "hull", "--masks", text(&masks)]);
    let iou = tiny.volume_iou(&run.join("mesh.ply"));
    assert!(iou > 0.8, "{iou}");
    assert!(succeeds(&dvr(&["eval", text(&run)])).contains("mean"));
    let (scene, out) = (tiny.scene(), tiny.path("refused"));
    let missing = tiny.path("nowhere");
    refuses(&dvr(&["train", text(&scene), "--out", text(&out), "--masks", text(&missing)]), &["nowhere"]);
    for word in ["cube", "off"] {
        let made = dvr(&["train", text(&Tiny::new().scene()), "--out", text(&out), "--masks", word]);
        refuses(&made, &[&format!("--masks {word}"), "no view has one"]);
    }
    assert!(!out.exists(), "nothing half-written");
}

#[test]
fn masks_that_no_view_has_and_that_cannot_be_found_leave_nothing_behind() {
    // The middle of the ring, which all cameras look at, is empty, and its colours are too smooth to compare.
    let tiny = Tiny::new();
    std::fs::remove_dir_all(tiny.scene().join("mask")).unwrap();
    let (scene, out, masks) = (tiny.scene(), tiny.path("refused"), tiny.path("masks"));
    let parts = ["no object was found", "--masks", "--background"];
    refuses(&dvr(&["train", text(&scene), "--out", text(&out)]), &parts);
    refuses(&dvr(&["masks", text(&scene), "--out", text(&masks)]), &parts);
    assert!(!out.exists() && !masks.exists(), "nothing half-written");
}

#[test]
fn holes_in_masks_are_given_back_unless_masks_are_taken_as_they_are() {
    let tiny = Tiny::rendered(shapes::torus(1.0, 0.45, 32, 16), 12, 64);
    for i in 0..12 {
        let path = tiny.scene().join(format!("mask/{i:04}.png"));
        let mut mask = read_mask(&path).unwrap().coverage.clone();
        let is_object = |u: u32, v: u32| mask.get_pixel(u, v).0[0] == 255;
        let around = |(u, v): (u32, u32)| (0..81).map(move |i| (u + i % 9 - 4, v + i / 9 - 4));
        let inner = |&at: &(u32, u32)| around(at).all(|(u, v)| is_object(u, v));
        let hole = (4..60).flat_map(|v| (4..60).map(move |u| (u, v))).find(inner).expect("the ring is that wide");
        around(hole).for_each(|(u, v)| {
            if u.abs_diff(hole.0) < 3 && v.abs_diff(hole.1) < 3 {
                mask.put_pixel(u, v, Luma([0]));
            }
        });
        write_gray_png(&path, &image::GrayImage::from_fn(64, 64, |u, v| *mask.get_pixel(u, v))).unwrap();
    }
    let (refined, told) = train(&tiny, "refined", &["--method", "hull"]);
    assert!(told.contains("masks leave out") && told.contains("--no-mask-refinement"), "{told}");
    let (given, told) = train(&tiny, "given", &["--method", "hull", "--no-mask-refinement"]);
    assert!(!told.contains("leave out"), "{told}");
    let [refined, given] = [refined, given].map(|run| tiny.volume_iou(&run.join("mesh.ply")));
    println!("volume IoU of the hull: {refined:.3} of refined masks, {given:.3} of masks as given");
    assert!(refined > given + 0.05, "{refined} {given}");
}

/// A box with a bump: nothing about it looks the same from two sides.
fn bump() -> Mesh {
    let mesh = shapes::union([
        shapes::cuboid(Vec3::new(-0.3, -0.2, -0.25), Vec3::new(0.3, 0.2, 0.25)),
        shapes::cuboid(Vec3::new(0.05, 0.1, -0.1), Vec3::new(0.2, 0.35, 0.15)),
    ]);
    let colors = mesh.vertices.iter().map(|v| [v.x + 0.5, v.y + 0.5, v.z + 0.5]).collect();
    Mesh { colors: Some(colors), ..mesh }
}

/// The matrices of `cameras.npz` of this name.
fn matrices(tiny: &Tiny, name: &str) -> Vec<DMat4> {
    let mut file = NpzFile::open(&tiny.scene().join("cameras.npz")).unwrap();
    let matrix = |i: usize| file.read(&format!("{name}_{i}")).unwrap().to_f64();
    (0..16).map(matrix).map(|m| DMat4::from_cols_slice(&m).transpose()).collect()
}

fn camera(world_to_camera: &DMat4) -> Camera {
    let eye = Camera::look_at(48, 48, 42.0, DVec3::Z, DVec3::ZERO, DVec3::Y);
    let rotation = DMat3::from_mat4(*world_to_camera);
    Camera { rotation, translation: world_to_camera.w_axis.truncate(), ..eye }
}

/// Pixels between the pictures of corners around the object's middle, in cameras that were first brought to where they
/// are nearest to the exact ones.
fn distance(exact: &[Camera], other: &[Camera]) -> f64 {
    let gauge = Similarity::between_cameras(other, exact).unwrap();
    let corner = |i: usize| 0.25 * DVec3::new([-1.0, 1.0][i & 1], [-1.0, 1.0][i >> 1 & 1], [-1.0, 1.0][i >> 2]);
    let squares = exact.iter().zip(other).flat_map(|(a, b)| {
        let b = b.into_world(&gauge);
        (0..8).map(move |i| (a.project(corner(i)).0 - b.project(corner(i)).0).length_squared())
    });
    (squares.sum::<f64>() / (8 * exact.len()) as f64).sqrt()
}

#[test]
fn refined_cameras_are_written_and_nearer_to_the_true_ones() {
    let tiny = Tiny::rendered(bump(), 16, 48);
    let exact = matrices(&tiny, "world_mat");
    let turned = exact.iter().enumerate().map(|(i, exact)| {
        let i = i as f64;
        let axis = DVec3::new((2.1 * i).sin(), (3.7 * i).cos(), (1.3 * i + 1.0).sin()).normalize();
        DMat4::from_axis_angle(axis, 1f64.to_radians()) * *exact
    });
    let turned: Vec<DMat4> = turned.collect();
    let named = [("camera_mat", matrices(&tiny, "camera_mat")), ("world_mat", turned.clone())];
    let scale = ("scale_mat", matrices(&tiny, "scale_mat"));
    let arrays: Vec<(String, Array)> = named
        .into_iter()
        .chain([scale])
        .flat_map(|(name, all)| {
            let array = |matrix: &DMat4| Array::f64(&[4, 4], matrix.transpose().to_cols_array().to_vec());
            all.iter().enumerate().map(|(i, matrix)| (format!("{name}_{i}"), array(matrix))).collect::<Vec<_>>()
        })
        .collect();
    let arrays: Vec<_> = arrays.iter().map(|(name, array)| (name.as_str(), array)).collect();
    write_npz(&tiny.scene().join("cameras.npz"), &arrays).unwrap();

    let (run, told) = train(&tiny, "run", &["--refine-cameras", "5", "--steps", "10", "--capacity", "32"]);
    assert!(told.contains("camera"), "{told}");
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(run.join("cameras.json")).unwrap()).unwrap();
    let frames = json["frames"].as_array().unwrap().iter().map(|frame| {
        let number = |i: usize| frame["transform_matrix"][i / 4][i % 4].as_f64().unwrap();
        let to_world = DMat4::from_cols_array(&std::array::from_fn(number)).transpose();
        DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0)) * to_world.inverse()
    });
    let [exact, turned, refined] =
        [exact, turned, frames.collect()].map(|matrices| matrices.iter().map(camera).collect::<Vec<_>>());
    let (before, after) = (distance(&exact, &turned), distance(&exact, &refined));
    println!("cameras are off by {before:.3} pixels, refined by {after:.3}");
    assert!(after < 0.9 * before, "{before} pixels before, {after} after");
    let (plain, _) = train(&tiny, "plain", &["--steps", "10", "--capacity", "32"]);
    assert!(!plain.join("cameras.json").exists());
}
