//! Training, validation and test views: who looks at which, from the command line.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::dataset::{ReadOptions, read_scene, write_transforms};
use dvr_core::{Camera, View};
use image::{Rgba, RgbaImage};

/// Settings of a grid that takes a second.
const COARSE: [&str; 8] =
    ["--steps", "40", "--capacity", "32", "--set", "first_cells=16", "--set", "color_coarseness=1"];

/// Trains a grid on a scene, with more arguments.
fn train(scene: &Path, out: &Path, more: &[&str]) -> Output {
    let args = ["train", text(scene), "--out", text(out), "--resolution", "32"];
    dvr(&[&args[..], &COARSE, more].concat())
}

/// Goes on with a stopped run.
fn resume(out: &Path) -> Output {
    dvr(&["train", "--resume", "--out", text(out), "--resolution", "32"])
}

fn figures(run: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap()
}

/// The stored field of a run.
fn field(run: &Path) -> Vec<u8> {
    let bytes = std::fs::read(run.join("scene.dvr")).unwrap();
    safetensors::SafeTensors::deserialize(&bytes).unwrap().tensor("model").unwrap().data().to_vec()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The picture, mask and depth map of a view of the tiny scene.
fn files(scene: &Path, view: &str) -> Vec<PathBuf> {
    let folders = ["image", "mask", "depth"].map(|folder| scene.join(folder));
    let of_folder = |folder: &PathBuf| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let all: Vec<PathBuf> = folders.iter().flat_map(|folder| -> Vec<PathBuf> { of_folder(folder) }).collect();
    all.into_iter().filter(|path| path.file_stem().is_some_and(|stem| stem == view)).collect()
}

/// Takes the files of a view away, and tells how to put them back.
fn taken_away(scene: &Path, view: &str) -> impl FnOnce() {
    let kept: Vec<(PathBuf, Vec<u8>)> =
        files(scene, view).into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect();
    assert!(kept.len() >= 2, "a picture and a mask");
    kept.iter().for_each(|(path, _)| std::fs::remove_file(path).unwrap());
    move || kept.iter().for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap())
}

#[test]
fn every_view_has_a_part_that_console_figures_and_report_name() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let output = train(&scene, &run, &[]);
    let printed = succeeds(&output);
    let said = said(&output);
    let parts = "10 to train on; 1 for validation (0008); 1 for testing (0004)";
    assert!(said.contains(parts) && said.contains("one view in 8 is left out for testing"), "{said}");
    for figure in
        ["test views, field: PSNR", "test views, mesh : PSNR", "validation views, field (they guided the run)"]
    {
        assert!(printed.contains(figure), "{figure:?} is missing in: {printed}");
    }
    let figures = figures(&run);
    assert_eq!((&figures["views"]["test"][0], &figures["views"]["validation"][0]), (&"0004".into(), &"0008".into()));
    assert_eq!(figures["views"]["train"].as_array().unwrap().len(), 10);
    assert!(figures["test_mesh"]["psnr"].is_f64() && figures["validation"]["psnr"].is_f64(), "{figures}");
    let curves = std::fs::read_to_string(run.join("metrics.csv")).unwrap();
    assert!(curves.lines().next().unwrap().contains(",validation_psnr,validation_mask_iou,"), "{curves}");
    let report = std::fs::read_to_string(run.join("report.html")).unwrap();
    assert!(report.contains("for testing (nothing is chosen by them)") && report.contains("left out for testing"));

    let table = succeeds(&dvr(&["eval", text(&run), "--resolution", "32"]));
    let views = table.split("test views").nth(1).unwrap();
    assert!(views.contains("0004") && !views.contains("0008") && !views.contains("0003"), "{table}");
    let output = dvr(&["render", text(&run), "--out", text(&tiny.path("frames")), "--cameras", "dataset"]);
    succeeds(&output);
    assert!(String::from_utf8_lossy(&output.stderr).contains(parts));
}

#[test]
fn test_pictures_change_the_final_figures_and_nothing_else() {
    let tiny = Tiny::new();
    let (scene, [clean, spoiled]) = (tiny.scene(), ["clean", "spoiled"].map(|run| tiny.path(run)));
    succeeds(&train(&scene, &clean, &[]));
    for path in files(&scene, "0004").iter().filter(|path| path.extension().is_some_and(|end| end != "exr")) {
        let mut picture = image::open(path).unwrap();
        picture.invert();
        picture.save(path).unwrap();
    }
    succeeds(&train(&scene, &spoiled, &[]));
    assert!(field(&clean) == field(&spoiled), "bit for bit");
    let [clean, spoiled] = [clean, spoiled].map(|run| figures(&run));
    assert_eq!(clean["validation"], spoiled["validation"]);
    assert_eq!(clean["notes"], spoiled["notes"]);
    let psnr = |figures: &serde_json::Value| figures["test"]["psnr"].as_f64().unwrap();
    assert!(psnr(&spoiled) < psnr(&clean) - 3.0, "{} and {}", psnr(&clean), psnr(&spoiled));
}

#[test]
fn alpha_of_test_pictures_does_not_say_where_the_object_is() {
    let tiny = Tiny::new();
    let [scene, clean, spoiled] = ["nerf", "clean", "spoiled"].map(|name| tiny.path(name));
    nerf(&tiny, &scene, &[("", 0..12)]);
    succeeds(&train(&scene, &clean, &[]));
    assert_eq!(figures(&clean)["views"]["test"], serde_json::json!(["0004"]));
    emptied(&scene.join("0004.png"));
    succeeds(&train(&scene, &spoiled, &[]));
    assert!(field(&clean) == field(&spoiled), "bit for bit");
    emptied(&scene.join("0005.png"));
    succeeds(&train(&scene, &spoiled, &["--overwrite"]));
    assert!(field(&clean) != field(&spoiled), "a view to train on does");
}

/// Takes the object out of a picture's alpha channel, but for its upper half.
fn emptied(path: &Path) {
    let mut picture = image::open(path).unwrap().into_rgba8();
    let height = picture.height();
    picture.enumerate_pixels_mut().filter(|(_, v, _)| 2 * v > height).for_each(|(_, _, pixel)| pixel.0[3] = 0);
    picture.save(path).unwrap();
}

#[test]
fn a_photograph_that_comes_later_is_left_out_and_the_run_ends_as_without_it() {
    let tiny = Tiny::new();
    let (scene, [whole, parts]) = (tiny.scene(), ["whole", "parts"].map(|run| tiny.path(run)));
    let put_back = taken_away(&scene, "0002");
    succeeds(&train(&scene, &whole, &[]));
    succeeds(&train(&scene, &parts, &["--time", "0s"]));
    put_back();
    let output = resume(&parts);
    succeeds(&output);
    assert!(said(&output).contains("came after the run began are left out (1): 0002"), "{}", said(&output));
    assert!(field(&whole) == field(&parts), "bit for bit");
    let [whole, parts_figures] = [&whole, &parts].map(|run| figures(run));
    for part in ["views", "test", "test_mesh", "validation"] {
        assert_eq!(whole[part], parts_figures[part], "{part}");
    }
    let output = dvr(&["eval", text(&parts), "--resolution", "32"]);
    assert!(succeeds(&output).contains("0006"), "of the eleven views, the middle one tests");
    assert!(said(&output).contains("left out (1): 0002"), "{}", said(&output));
}

#[test]
fn a_photograph_that_is_gone_is_said_and_no_run_goes_on_without_what_it_learned_from() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    succeeds(&train(&scene, &run, &["--time", "0s"]));
    for view in ["0003", "0008"] {
        let put_back = taken_away(&scene, view);
        refuses(&resume(&run), &["trained on or chose by", view, "Put them back"]);
        put_back();
    }
    let _ = taken_away(&scene, "0004");
    let output = resume(&run);
    succeeds(&output);
    assert!(said(&output).contains("gone, 1 for testing: 0004"), "{}", said(&output));
    let figures = figures(&run);
    assert!(figures["test"].is_null() && figures["views"]["test"][0] == "0004", "{figures}");
    assert!(figures["warnings"].to_string().contains("gone, 1 for testing: 0004"), "{figures}");
    let output = dvr(&["eval", text(&run), "--resolution", "32"]);
    assert!(succeeds(&output).contains("Chamfer-L1") && said(&output).contains("gone, 1 for testing: 0004"));
}

#[test]
fn few_views_lose_one_or_none_and_the_run_says_which() {
    let tiny = Tiny::new();
    let scene = tiny.scene();
    let few = |views: &str, more: &[&str]| {
        let run = tiny.path(views);
        let output = train(&scene, &run, &[&["--views", views], more].concat());
        succeeds(&output);
        (said(&output), figures(&run))
    };
    let (text, figures) = few("8", &[]);
    assert!(text.contains("7 to train on; 0 for validation; 1 for testing"), "{text}");
    assert!(text.contains("8 views are few") && text.contains("nothing is chosen by views"), "{text}");
    assert!(figures["test"]["psnr"].is_f64() && figures["validation"].is_null(), "{figures}");
    let (text, figures) = few("4", &[]);
    assert!(text.contains("4 views are too few to leave one out"), "{text}");
    assert!(figures["test"].is_null() && figures["views"]["rule"].as_str().unwrap().contains("too few"), "{figures}");
    let (text, figures) = few("12", &["--set", "hold_out_every=0"]);
    assert!(text.contains("12 to train on; 0 for validation; 0 for testing; no view is left out"), "{text}");
    assert!(figures["test"].is_null(), "{figures}");
}

/// The tiny scene in NeRF's layout, with views for these purposes; for none, the dataset does not say.
fn nerf(tiny: &Tiny, scene: &Path, parts: &[(&str, Range<usize>)]) {
    let found = read_scene(&tiny.scene(), &ReadOptions::default()).unwrap();
    let cameras: Vec<Camera> = found.views.iter().map(|view| view.camera.into_world(&found.object_to_world)).collect();
    for (split, range) in parts.iter().cloned() {
        std::fs::create_dir_all(scene.join(split)).unwrap();
        let folder = Path::new(split);
        let name = |i: usize| folder.join(format!("{}.png", found.views[i].name)).display().to_string();
        let names: Vec<String> = range.clone().map(name).collect();
        let frames = names.iter().map(String::as_str).zip(&cameras[range.clone()]);
        let file = if split.is_empty() { "transforms.json".to_owned() } else { format!("transforms_{split}.json") };
        write_transforms(&scene.join(file), frames, None).unwrap();
        names.iter().zip(&found.views[range]).for_each(|(name, view)| with_alpha(view).save(scene.join(name)).unwrap());
    }
}

/// A view's picture with its mask as alpha.
fn with_alpha(view: &View) -> RgbaImage {
    let mask = &view.mask.as_ref().unwrap().coverage;
    RgbaImage::from_fn(view.image.width(), view.image.height(), |u, v| {
        let [red, green, blue] = view.image.get_pixel(u, v).0;
        Rgba([red, green, blue, mask.get_pixel(u, v).0[0]])
    })
}

#[test]
fn a_dataset_that_says_what_its_views_are_for_is_believed() {
    let tiny = Tiny::new();
    let (scene, run, spoiled) = (tiny.path("nerf"), tiny.path("run"), tiny.path("spoiled"));
    nerf(&tiny, &scene, &[("train", 0..9), ("val", 9..10), ("test", 10..12)]);
    let output = train(&scene, &run, &[]);
    succeeds(&output);
    let said = said(&output);
    assert!(said.contains("9 to train on; 1 for validation (0009); 2 for testing (0010, 0011)"), "{said}");
    assert!(said.contains("the dataset says which views are for testing"), "{said}");
    assert_eq!(figures(&run)["views"]["test"], serde_json::json!(["0010", "0011"]));

    // Alpha, from which the masks are, included: test views have no say in where the object is.
    for view in ["0010", "0011"] {
        let path = scene.join(format!("test/{view}.png"));
        let mut picture = image::open(&path).unwrap().into_rgba8();
        picture.pixels_mut().for_each(|pixel| pixel.0 = pixel.0.map(|channel| 255 - channel));
        picture.save(&path).unwrap();
    }
    succeeds(&train(&scene, &spoiled, &[]));
    assert!(field(&run) == field(&spoiled), "bit for bit");
}
