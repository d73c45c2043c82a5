//! What a user can get wrong: a clear message, exit code 2, and nothing half-written.

use std::path::Path;

use crate::support::{Tiny, dvr, refuses, succeeds, text};

/// Training on the scene is refused with these words, and the output folder holds nothing.
fn train_refuses(tiny: &Tiny, parts: &[&str]) {
    refuses(&tiny.train("refused", &[]), parts);
    assert!(!tiny.path("refused").join("last.ckpt").exists());
    assert!(!tiny.path("refused").join("config.json").exists(), "nothing half-written");
}

fn truncate(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

#[test]
fn a_missing_scene_and_an_empty_folder_are_named() {
    let tiny = Tiny::new();
    refuses(&dvr(&["info", text(&tiny.path("nowhere"))]), &["nowhere"]);
    std::fs::create_dir(tiny.path("empty")).unwrap();
    refuses(&dvr(&["info", text(&tiny.path("empty"))]), &["empty", "cameras.npz", "transforms"]);
}

#[test]
fn truncated_files_are_named() {
    for file in ["image/0003.png", "cameras.npz", "depth/0004.exr", "mask/0002.png"] {
        let tiny = Tiny::new();
        truncate(&tiny.scene().join(file));
        train_refuses(&tiny, &[Path::new(file).file_name().unwrap().to_str().unwrap()]);
    }
}

#[test]
fn a_missing_image_is_named() {
    let tiny = Tiny::new();
    std::fs::remove_file(tiny.scene().join("mask/0005.png")).unwrap();
    train_refuses(&tiny, &["mask"]);
}

#[test]
fn a_mesh_is_not_measured_on_views_without_masks_in_silence() {
    let tiny = Tiny::new();
    let (scene, mesh) = (tiny.scene(), tiny.path("mesh.ply"));
    dvr_core::mesh::write_mesh(&mesh, &dvr_core::mesh::shapes::icosphere(2, 0.4)).unwrap();
    let eval = |more: &[&str]| dvr(&[&["eval", text(&mesh), "--data", text(&scene)], more].concat());
    assert!(succeeds(&eval(&[])).contains("PSNR"));
    std::fs::remove_dir_all(scene.join("mask")).unwrap();
    refuses(&eval(&[]), &["no mask", "--no-views"]);
    assert!(succeeds(&eval(&["--no-views"])).contains("Chamfer-L1"));
}

/// Writes the scene's cameras again with one array changed.
fn change_camera(tiny: &Tiny, name: &str, change: impl Fn(&mut Vec<f64>)) {
    use dvr_core::npz::{Array, NpzFile, write_npz};
    let path = tiny.scene().join("cameras.npz");
    let mut file = NpzFile::open(&path).unwrap();
    let names = file.names().to_vec();
    let arrays: Vec<Array> = names
        .iter()
        .map(|array_name| {
            let array = file.read(array_name).unwrap();
            let mut values = array.to_f64();
            if array_name == name {
                change(&mut values);
            }
            Array::f64(&array.shape, values)
        })
        .collect();
    let entries: Vec<_> = names.iter().map(String::as_str).zip(&arrays).collect();
    write_npz(&path, &entries).unwrap();
}

#[test]
fn nan_and_singular_cameras_are_refused() {
    let tiny = Tiny::new();
    change_camera(&tiny, "world_mat_3", |m| m[2] = f64::NAN);
    train_refuses(&tiny, &["cameras.npz", "3"]);
    let tiny = Tiny::new();
    change_camera(&tiny, "camera_mat_1", |m| m.fill(0.0));
    train_refuses(&tiny, &["cameras.npz"]);
}

#[test]
fn masks_of_another_size_or_all_black_are_refused() {
    let tiny = Tiny::new();
    let path = tiny.scene().join("mask/0001.png");
    dvr_core::files::write_gray_png(&path, &image::GrayImage::new(10, 10)).unwrap();
    train_refuses(&tiny, &["10x10", "24x24"]);
    let tiny = Tiny::new();
    for i in 0..12 {
        let path = tiny.scene().join(format!("mask/{i:04}.png"));
        dvr_core::files::write_gray_png(&path, &image::GrayImage::new(24, 24)).unwrap();
    }
    train_refuses(&tiny, &["mask"]);
}

#[test]
fn one_view_is_not_enough() {
    let tiny = Tiny::new();
    refuses(&tiny.train("refused", &["--views", "1"]), &["1", "view"]);
    assert!(!tiny.path("refused").join("last.ckpt").exists());
}

#[test]
fn unknown_keys_and_values_out_of_range_are_named() {
    let tiny = Tiny::new();
    refuses(&tiny.train("r", &["--set", "losses.colour.weight=1"]), &["losses.colour", "color"]);
    refuses(&tiny.train("r", &["--set", "learning_rate=-1"]), &["learning_rate", "-1"]);
    refuses(&tiny.train("r", &["--set", "nonsense"]), &["KEY=VALUE"]);
    std::fs::write(tiny.path("c.json"), "{\"stepz\": 3}").unwrap();
    refuses(&tiny.train("r", &["--config", text(&tiny.path("c.json"))]), &["c.json", "stepz"]);
    std::fs::write(tiny.path("c.json"), "{").unwrap();
    refuses(&tiny.train("r", &["--config", text(&tiny.path("c.json"))]), &["c.json"]);
    refuses(&dvr(&["train", text(&tiny.scene()), "--out", "x", "--supervision", "sound"]), &["sound"]);
    assert!(!tiny.path("r").exists());
}

#[test]
fn depth_supervision_without_depth_maps_is_refused() {
    let tiny = Tiny::new();
    std::fs::remove_dir_all(tiny.scene().join("depth")).unwrap();
    refuses(&tiny.train("refused", &["--supervision", "depth"]), &["depth"]);
    assert!(!tiny.path("refused").join("config.json").exists());
}

#[test]
fn a_folder_that_holds_a_run_is_not_overwritten_by_accident() {
    let tiny = Tiny::new();
    succeeds(&tiny.train("run", &[]));
    let before = std::fs::read(tiny.path("run/last.ckpt")).unwrap();
    refuses(&tiny.train("run", &[]), &["already holds a run", "--resume", "--overwrite"]);
    assert_eq!(std::fs::read(tiny.path("run/last.ckpt")).unwrap(), before);

    // A checkpoint that is cut short, is no checkpoint, or comes from another version.
    let run = tiny.path("run");
    std::fs::remove_file(run.join("best.ckpt")).unwrap();
    truncate(&run.join("last.ckpt"));
    refuses(&dvr(&["mesh", text(&run)]), &["last.ckpt"]);
    std::fs::write(run.join("last.ckpt"), "no checkpoint").unwrap();
    refuses(&dvr(&["train", "--resume", "--out", text(&run)]), &["last.ckpt"]);
    let replaced = |pattern: &str, digit: u8| {
        let mut bytes = before.clone();
        let at = bytes.windows(pattern.len()).position(|w| w == pattern.as_bytes()).expect("the header has the key");
        bytes[at + pattern.len() - 1] = digit;
        bytes
    };
    let version = format!("\\\"version\\\":{}", dvr_train::CHECKPOINT_VERSION);
    std::fs::write(run.join("last.ckpt"), replaced(&version, b'9')).unwrap();
    refuses(&dvr(&["mesh", text(&run)]), &["version 9"]);
    // Parameters of another shape than the configuration says.
    std::fs::write(run.join("last.ckpt"), replaced("\\\"hidden\\\":32", b'3')).unwrap();
    refuses(&dvr(&["mesh", text(&run)]), &["do not fit"]);
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let tiny = Tiny::new();
    std::fs::write(tiny.path("file"), "").unwrap();
    refuses(&tiny.train("file/run", &[]), &["file"]);
    refuses(&tiny.train("/proc/dvr/run", &[]), &["/proc"]);
}

#[test]
fn a_run_that_is_not_there_is_named() {
    let tiny = Tiny::new();
    refuses(&dvr(&["mesh", text(&tiny.path("no_run"))]), &["no_run"]);
    refuses(&dvr(&["render", text(&tiny.path("no_run")), "--out", "x"]), &["no_run"]);
    refuses(&dvr(&["eval", text(&tiny.path("no_run"))]), &["no_run"]);
    refuses(&dvr(&["train", "--resume", "--out", text(&tiny.path("no_run"))]), &["no_run"]);
}
