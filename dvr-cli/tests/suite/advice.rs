//! What to photograph again: `dvr info` on copies of the demo scene that were made bad on purpose, and a run's report.

use std::path::PathBuf;

use crate::support::{Tiny, copy_demo, dvr, succeeds, text};
use dvr_core::files::{read_rgb, write_rgb_png};
use image::RgbImage;
use serde_json::Value;
use tempfile::TempDir;

/// A copy of the demo scene whose pictures may be changed.
struct Copy {
    folder: TempDir,
}

impl Copy {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy_demo(folder.path());
        Self { folder }
    }

    fn change(&self, view: usize, change: impl Fn(RgbImage) -> RgbImage) {
        let path: PathBuf = self.folder.path().join(format!("image/{view:04}.png"));
        write_rgb_png(&path, &change(read_rgb(&path).unwrap())).unwrap();
    }

    /// The notes that people see, and the advice of `--json`.
    fn told(&self, more: &[&str]) -> (String, Value) {
        let info = [&["info", text(self.folder.path())], more].concat();
        let output = dvr(&info);
        succeeds(&output);
        let json: Value = serde_json::from_str(&succeeds(&dvr(&[&info[..], &["--json"]].concat()))).unwrap();
        (String::from_utf8_lossy(&output.stderr).into_owned(), json["advice"].clone())
    }
}

#[test]
fn the_demo_scene_needs_no_new_photograph() {
    let (notes, advice) = Copy::new().told(&[]);
    assert_eq!((notes.as_str(), advice), ("", Value::Array(Vec::new())));
}

#[test]
fn a_blurred_a_burnt_and_a_black_picture_are_named_with_figure_threshold_and_place() {
    let copy = Copy::new();
    copy.change(6, |picture| image::imageops::blur(&picture, 2.0));
    let times = |factor: f32| {
        move |mut picture: RgbImage| {
            picture.iter_mut().for_each(|level| *level = (f32::from(*level) * factor).min(255.0) as u8);
            picture
        }
    };
    copy.change(13, times(3.0));
    copy.change(21, times(0.03));
    let (notes, advice) = copy.told(&[]);
    for (topic, view, words) in [("blur", "0006", "steady"), ("burnt", "0013", "shorter"), ("black", "0021", "longer")]
    {
        let found = advice.as_array().unwrap().iter().find(|advice| advice["topic"] == topic);
        let found = found.unwrap_or_else(|| panic!("{topic} is missing in {advice}"));
        assert_eq!(found["views"][0]["view"], view, "{found}");
        assert!(found["views"][0]["figure"].is_number() && found["threshold"].is_number(), "{found}");
        let said = found["text"].as_str().unwrap();
        assert!(said.contains(&format!("`{view}`")) && said.contains("azimuth") && said.contains(words), "{said}");
        assert!(notes.contains(&format!("note: {said}\n")), "{notes}");
    }
}

#[test]
fn few_views_have_too_little_overlap() {
    let (_, advice) = Copy::new().told(&["--views", "5"]);
    let topics: Vec<&str> = advice.as_array().unwrap().iter().filter_map(|advice| advice["topic"].as_str()).collect();
    assert!(topics.contains(&"overlap"), "{advice}");
}

#[test]
fn a_run_says_it_in_its_notes_and_its_report() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("run"));
    for view in [2, 5] {
        let path = scene.join(format!("image/{view:04}.png"));
        let white = read_rgb(&path).unwrap();
        write_rgb_png(&path, &RgbImage::from_pixel(white.width(), white.height(), image::Rgb([255; 3]))).unwrap();
    }
    let small = ["--steps", "10", "--capacity", "32", "--resolution", "32", "--no-mask-refinement"];
    let output = dvr(&[&["train", text(&scene), "--out", text(&out)][..], &small].concat());
    succeeds(&output);
    let notes = String::from_utf8_lossy(&output.stderr);
    assert!(notes.contains("burnt") && notes.contains("`0002` (100 %"), "{notes}");
    let metrics = std::fs::read_to_string(out.join("metrics.json")).unwrap();
    let report = std::fs::read_to_string(out.join("report.html")).unwrap();
    for page in [metrics, report] {
        assert!(page.contains("photograph these again with a shorter exposure"), "the advice is missing");
    }
}
