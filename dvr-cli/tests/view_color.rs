//! Colours that depend on the viewing direction, from the command line.

mod support;

use std::path::Path;

use dvr_core::dataset::{ReadOptions, read_scene};
use support::{Tiny, copy_demo, dvr, refuses, succeeds, text};

/// Renders an orbit around a run, with more arguments; returns the first picture.
fn rendered(tiny: &Tiny, run: &Path, out: &str, more: &[&str]) -> Vec<u8> {
    let out = tiny.path(out);
    let args = ["render", text(run), "--out", text(&out), "--frames", "8", "--size", "64", "--animation", "none"];
    succeeds(&dvr(&[&args[..], more].concat()));
    std::fs::read(out.join("orbit_0000.png")).unwrap()
}

/// A copy of the demo scene whose photographs are the redder the more they look along x: what depends on the direction,
/// of all of the object alike.
fn shining(copy: &Path) {
    copy_demo(copy);
    for view in read_scene(copy, &ReadOptions::default()).unwrap().views {
        let along = view.camera.rotation.row(2).x;
        let path = copy.join("image").join(format!("{}.png", view.name));
        let mut picture = image::open(&path).unwrap().into_rgba8();
        picture.pixels_mut().for_each(|pixel| pixel.0[0] = (f64::from(pixel.0[0]) * (0.7 + 0.3 * along)) as u8);
        picture.save(&path).unwrap();
    }
}

#[test]
fn where_nothing_depends_on_the_direction_there_are_none() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let train = ["train", text(&scene), "--out", text(&run), "--resolution", "32", "--capacity", "32"];
    let coarse = ["--steps", "60", "--set", "first_cells=16", "--set", "color_coarseness=1"];
    succeeds(&dvr(&[&train[..], &coarse].concat()));
    assert!(run.join("scene.dvr").exists() && !run.join("view_color.safetensors").exists());
}

#[test]
fn a_run_keeps_them_and_is_rendered_with_them_unless_somebody_does_not_want_it() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.path("mug"), tiny.path("run"));
    shining(&scene);
    let train = ["train", text(&scene), "--out", text(&run), "--resolution", "32", "--capacity", "32"];
    let said = succeeds(&dvr(&[
        &train[..],
        &[
            "--steps",
            "60",
            "--set",
            "first_cells=16",
            "--set",
            "color_coarseness=1",
            "--set",
            "exposure=off",
            "--set",
            "plane_sweep_pixels=0",
            "--texture",
            "off",
            "--no-report",
        ],
    ]
    .concat()));
    assert!(said.contains("field with view-dependent colour") && said.contains("view_color.safetensors"), "{said}");
    let stored = run.join("view_color.safetensors");
    let bytes = std::fs::read(&stored).unwrap();
    let figures: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap();
    assert!(figures["test_view_color"]["psnr"].is_f64(), "{figures}");

    let (on, off) = (rendered(&tiny, &run, "on", &[]), rendered(&tiny, &run, "off", &["--view-color", "off"]));
    assert!(on != off);
    // A checkpoint by itself may be that of another step.
    let checkpoint = run.join("last.ckpt");
    assert!(rendered(&tiny, &checkpoint, "checkpoint", &[]) == off);

    // A damaged file is named, and nothing is written.
    std::fs::write(&stored, &bytes[..bytes.len() / 2]).unwrap();
    let out = tiny.path("damaged");
    let args = ["render", text(&run), "--out", text(&out), "--frames", "8", "--size", "64", "--animation", "none"];
    refuses(&dvr(&args), &["view_color.safetensors", "without the file"]);
    assert!(!out.exists());
    assert!(rendered(&tiny, &run, "off_again", &["--view-color", "off"]) == off);
    // The results that follow when the run goes on bring it back.
    succeeds(&dvr(&[
        "train",
        "--resume",
        "--out",
        text(&run),
        "--resolution",
        "32",
        "--texture",
        "off",
        "--no-report",
    ]));
    assert!(std::fs::read(&stored).unwrap() == bytes, "the same for the same field");
}
