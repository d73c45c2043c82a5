//! Colours that depend on the viewing direction, from the command line.

use std::path::Path;

use crate::support::{Tiny, copy_demo, dvr, refuses, succeeds, text};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_render::ViewColor;

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

/// Settings of a field whose colours are as fine as its cells.
const FINE_COLORS: [&str; 8] =
    ["--resolution", "32", "--steps", "60", "--set", "first_cells=16", "--set", "color_coarseness=1"];

/// Trains on a shining scene; returns what is said.
fn trained(scene: &Path, run: &Path, more: &[&str]) -> String {
    let train = ["train", text(scene), "--out", text(run), "--capacity", "32", "--no-report"];
    let plain = ["--set", "exposure=off", "--set", "plane_sweep_pixels=0"];
    succeeds(&dvr(&[&train[..], &plain, more].concat()))
}

#[test]
fn where_nothing_depends_on_the_direction_there_are_none() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let train = ["train", text(&scene), "--out", text(&run), "--capacity", "32", "--texture", "off"];
    succeeds(&dvr(&[&train[..], &FINE_COLORS].concat()));
    assert!(run.join("scene.dvr").exists() && !run.join("view_color.safetensors").exists());
}

#[test]
fn a_run_keeps_them_and_is_rendered_with_them_unless_somebody_does_not_want_it() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.path("mug"), tiny.path("run"));
    shining(&scene);
    let said = trained(&scene, &run, &[&FINE_COLORS[..], &["--texture", "off"]].concat());
    assert!(said.contains("(field with view-dependent colour)") && said.contains("view_color.safetensors"), "{said}");
    let stored = run.join("view_color.safetensors");
    let bytes = std::fs::read(&stored).unwrap();
    let figures: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap();
    assert!(
        figures["test_pictures"]["psnr"].is_f64() && figures["pictures_of"] == "field-with-view-color",
        "{figures}"
    );

    let (on, off) = (rendered(&tiny, &run, "on", &[]), rendered(&tiny, &run, "off", &["--view-color", "off"]));
    assert!(on != off);
    // A checkpoint by itself may be that of another step.
    let checkpoint = run.join("last.ckpt");
    assert!(rendered(&tiny, &checkpoint, "checkpoint", &[]) == off);

    // A damaged file is named, and nothing is written.
    std::fs::write(&stored, &bytes[..bytes.len() / 2]).unwrap();
    let out = tiny.path("damaged");
    let args = ["render", text(&run), "--out", text(&out), "--frames", "8", "--size", "64", "--animation", "none"];
    refuses(&dvr(&args), &["view_color.safetensors", "of its field"]);
    assert!(!out.exists());
    // What the sentence says is so.
    std::fs::remove_file(&stored).unwrap();
    assert!(rendered(&tiny, &run, "without", &[]) == off);
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

#[test]
fn they_are_those_of_the_mesh_where_its_texture_shows_more_as_long_as_it_is_the_same() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.path("mug"), tiny.path("run"));
    shining(&scene);
    let said = trained(&scene, &run, &["--resolution", "64", "--steps", "100", "--texture", "512"]);
    assert!(said.contains("(mesh with view-dependent colour)"), "{said}");
    let figures = std::fs::read_to_string(run.join("metrics.json")).unwrap();
    let figures: serde_json::Value = serde_json::from_str(&figures).unwrap();
    assert_eq!(figures["pictures_of"], "mesh-with-view-color");
    let of_mesh = rendered(&tiny, &run, "of_mesh", &[]);

    // The views that are measured are those that are shown: all pixels of them here, a part of them at the end of the run.
    let json = tiny.path("eval.json");
    let said = succeeds(&dvr(&["eval", text(&run), "--resolution", "64", "--json", text(&json)]));
    assert!(said.contains("test views of the mesh with view-dependent colour"), "{said}");
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    let of_views: Vec<f64> = report["views"].as_array().unwrap().iter().map(|v| v["psnr"].as_f64().unwrap()).collect();
    let (mean, kept) = (of_views.iter().sum::<f64>() / of_views.len() as f64, &figures["test_pictures"]["psnr"]);
    assert!((mean - kept.as_f64().unwrap()).abs() < 0.7, "{mean} and {kept}");

    // A run of an earlier version did not say what its colours were fitted to: it was the field.
    let (stored, glb) = (run.join("view_color.safetensors"), std::fs::read(run.join("mesh.glb")).unwrap());
    let bytes = std::fs::read(&stored).unwrap();
    let color = ViewColor::from_bytes(&bytes).unwrap();
    let field = rendered(&tiny, &run.join("last.ckpt"), "field", &[]);
    std::fs::write(&stored, color.to_bytes(r#""field""#).unwrap()).unwrap();
    let of_field = rendered(&tiny, &run, "of_field", &[]);
    assert!(of_field != of_mesh && of_field != field);
    // Where the mesh alone is shown there are no colours for directions, and its place is told all the same.
    let place = ViewColor::surface_of(&bytes).unwrap().unwrap();
    std::fs::write(&stored, ViewColor::none().to_bytes(&place).unwrap()).unwrap();
    let plain = rendered(&tiny, &run, "plain", &[]);
    assert!(plain != of_mesh && plain != field);
    for wrong in ["{}", "\"sphere\"", &place.replace("\"scale\":", "\"scale\":-")] {
        std::fs::write(&stored, color.to_bytes(wrong).unwrap()).unwrap();
        let out = tiny.path("wrong");
        refuses(&dvr(&["render", text(&run), "--out", text(&out)]), &["view_color.safetensors", "of its field"]);
        assert!(!out.exists());
    }
    std::fs::write(&stored, bytes).unwrap();
    assert!(rendered(&tiny, &run, "off", &["--view-color", "off"]) == plain);

    // Another mesh in its place, or none, shows something else: pictures are of the field, and say so.
    let shows_field = |name: &str| {
        let out = tiny.path(name);
        let args = ["render", text(&run), "--out", text(&out), "--frames", "8", "--size", "64", "--animation", "none"];
        let output = dvr(&args);
        succeeds(&output);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(
            said.contains("mesh.glb: this is not the mesh that the run made") && said.contains("--resume"),
            "{said}"
        );
        assert!(std::fs::read(out.join("orbit_0000.png")).unwrap() == field);
    };
    succeeds(&dvr(&["mesh", text(&run), "--resolution", "16", "--texture", "off"]));
    shows_field("other");
    std::fs::remove_file(run.join("mesh.glb")).unwrap();
    shows_field("gone");
    std::fs::write(run.join("mesh.glb"), glb).unwrap();
    assert!(rendered(&tiny, &run, "again", &[]) == of_mesh);
}
