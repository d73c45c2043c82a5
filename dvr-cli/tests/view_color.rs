//! Colours that depend on the viewing direction, from the command line.

mod support;

use std::path::Path;

use support::{Tiny, dvr, refuses, succeeds, text};

/// Renders the views of a run's scene, with more arguments; returns the first picture.
fn rendered(tiny: &Tiny, run: &Path, out: &str, more: &[&str]) -> Vec<u8> {
    let out = tiny.path(out);
    let args = ["render", text(run), "--out", text(&out), "--cameras", "dataset", "--animation", "none"];
    succeeds(&dvr(&[&args[..], more].concat()));
    std::fs::read(out.join("0000.png")).unwrap()
}

#[test]
fn a_run_keeps_them_and_is_rendered_with_them_unless_somebody_does_not_want_it() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    // Of fewer than twelve views none validates, and they are kept though nothing here shines.
    for (folder, ending) in [("image", "png"), ("mask", "png"), ("depth", "exr")] {
        std::fs::remove_file(scene.join(folder).join(format!("0003.{ending}"))).unwrap();
    }
    let train = ["train", text(&scene), "--out", text(&run), "--resolution", "32", "--capacity", "32"];
    let said =
        succeeds(&dvr(
            &[&train[..], &["--steps", "60", "--set", "first_cells=16", "--set", "color_coarseness=1"]].concat()
        ));
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
    let args = ["render", text(&run), "--out", text(&out), "--cameras", "dataset", "--animation", "none"];
    refuses(&dvr(&args), &["view_color.safetensors", "without the file"]);
    assert!(!out.exists());
    assert!(rendered(&tiny, &run, "off_again", &["--view-color", "off"]) == off);
    // The results that follow when the run goes on bring it back.
    succeeds(&dvr(&["train", "--resume", "--out", text(&run), "--resolution", "32"]));
    assert!(std::fs::read(&stored).unwrap() == bytes, "the same for the same field");
}
