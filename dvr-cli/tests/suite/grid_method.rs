//! The grid method from the command line: quality, resuming, capacity, and the hull that it must beat.

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::read_mesh;

/// The figures of a run.
fn metrics(tiny: &Tiny, run: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(tiny.path(run).join("metrics.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// The stored field of a run.
fn field(tiny: &Tiny, run: &str) -> Vec<u8> {
    let bytes = std::fs::read(tiny.path(run).join("scene.dvr")).unwrap();
    safetensors::SafeTensors::deserialize(&bytes).unwrap().tensor("model").unwrap().data().to_vec()
}

/// Trains with a coarse mesh at the end.
fn train(tiny: &Tiny, run: &str, more: &[&str]) -> std::process::Output {
    let (scene, out) = (tiny.scene(), tiny.path(run));
    let mut args = vec!["train", text(&scene), "--out", text(&out), "--resolution", "32"];
    args.extend(more);
    dvr(&args)
}

#[test]
fn it_beats_the_hull_and_notes_its_resolution() {
    let tiny = Tiny::new();
    succeeds(&train(&tiny, "hull", &["--method", "hull"]));
    let output = train(&tiny, "grid", &["--steps", "150"]);
    succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("32 cells") && said.contains("bytes stored"), "{said}");
    let iou = |run: &str| metrics(&tiny, run)["shape"]["volume_iou"].as_f64().unwrap();
    assert!(iou("grid") > iou("hull") && iou("grid") > 0.8, "{} against {}", iou("grid"), iou("hull"));
    let bytes = metrics(&tiny, "grid")["bytes"].as_u64().unwrap();
    assert!(bytes > 1000 && bytes < 60_000, "{bytes}");
    let textured = read_mesh(tiny.path("grid/mesh.glb")).unwrap();
    assert!(textured.materials.iter().any(|material| material.texture.is_some()));
    assert!(read_mesh(tiny.path("grid/mesh.ply")).unwrap().mesh.colors.is_some());

    // Whatever takes a run takes its compact field alone.
    let scene_file = tiny.path("grid/scene.dvr");
    assert!(std::fs::metadata(&scene_file).unwrap().len() < bytes + 6_000, "the field and a header");
    let table = succeeds(&dvr(&["eval", text(&scene_file), "--resolution", "32"]));
    assert!(table.contains("volume IoU") && table.contains("PSNR"), "{table}");
    let obj = tiny.path("again.obj");
    succeeds(&dvr(&["mesh", text(&scene_file), "--out", text(&obj), "--resolution", "48", "--colors", "field"]));
    let simple = tiny.path("simple.obj");
    succeeds(&dvr(&["mesh", text(&scene_file), "--out", text(&simple), "--resolution", "48", "--simplify", "0.002"]));
    let dual = tiny.path("dual.obj");
    succeeds(&dvr(&["mesh", text(&scene_file), "--out", text(&dual), "--resolution", "48", "--contour", "dual"]));
    assert_ne!(read_mesh(&dual).unwrap().mesh.vertices, read_mesh(&obj).unwrap().mesh.vertices);
    let faces = |path| read_mesh(path).unwrap().mesh.faces.len();
    assert!(faces(&simple) > 50 && 2 * faces(&simple) < faces(&obj), "{} of {}", faces(&simple), faces(&obj));
    let frames = tiny.path("frames");
    succeeds(&dvr(&["render", text(&scene_file), "--out", text(&frames), "--frames", "2", "--size", "24"]));
    assert!(frames.join("orbit_0001.png").is_file());
    refuses(&dvr(&["export", text(&scene_file), "--out", "x.safetensors"]), &["grid", "--method network"]);
}

#[test]
fn a_stopped_run_resumes_to_the_same_field() {
    let tiny = Tiny::new();
    let more = ["--steps", "40", "--capacity", "32", "--set", "first_cells=16", "--set", "color_coarseness=1"];
    succeeds(&train(&tiny, "whole", &more));
    let mut stopped = more.to_vec();
    stopped.extend(["--time", "0s"]);
    succeeds(&train(&tiny, "parts", &stopped));
    let parts = tiny.path("parts");
    succeeds(&dvr(&["train", "--resume", "--out", text(&parts), "--resolution", "32"]));
    assert!(field(&tiny, "whole") == field(&tiny, "parts"), "bit for bit");
}

/// Bytes that a run like this one takes beside its photographs, as it is estimated.
fn beside_photographs(tiny: &Tiny, run: &str) -> u64 {
    let checkpoint = dvr_train::RunFolder::new(tiny.path(run)).load().unwrap();
    let method = dvr_train::method_of(&checkpoint.header.method).unwrap();
    let mut scene = dvr_core::Scene::read(tiny.scene()).unwrap();
    checkpoint.header.views.unwrap().apply(&mut scene).unwrap();
    let mesh = dvr_train::MeshOptions::with_resolution(32);
    dvr_train::HostMemory::of_run(method.as_ref(), &scene, &mesh).rest
}

#[test]
fn a_scene_larger_than_the_memory_for_it_gives_the_same_field_and_mesh() {
    let tiny = Tiny::new();
    let args = ["--steps", "40", "--capacity", "32", "--set", "first_cells=16", "--set", "color_coarseness=1"];
    let results = |run: &str, more: &[&str]| {
        succeeds(&train(&tiny, run, &[&args, more].concat()));
        (field(&tiny, run), std::fs::read(tiny.path(run).join("mesh.ply")).unwrap())
    };
    let in_memory = results("memory", &[]);
    // Twelve views of 24 x 24 pixels and 4 bytes: none, some, all of them in memory beside everything else.
    let rest = beside_photographs(&tiny, "memory");
    let budgets = [rest, rest + 8_000, 1_000_000_000].map(|bytes| bytes.to_string());
    for budget in &budgets {
        assert!(results(budget, &["--memory", budget]) == in_memory, "--memory {budget}: bit for bit");
    }
    let less = (rest - 1_000_000).to_string();
    let scarce = [&args[..], &["--memory", &less]].concat();
    refuses(&train(&tiny, "less", &scarce), &["MB of memory are needed", "--memory"]);
    assert!(!tiny.path("less").exists());
    // What comes after training reads the scene as training did.
    succeeds(&dvr(&["eval", text(&tiny.path(&budgets[0]).join("scene.dvr")), "--resolution", "32"]));
}

#[test]
fn invalid_memory_limits_and_missing_scratch_folders_are_named() {
    let tiny = Tiny::new();
    refuses(&train(&tiny, "x", &["--memory", "much"]), &["much", "500M or 2G"]);
    let scene = tiny.scene();
    let info = |memory: &str| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_dvr"));
        command.args(["info", text(&scene), "--memory", memory]).env("TMPDIR", "/no/such/folder").output().unwrap()
    };
    refuses(&info("0"), &["/no/such/folder", "TMPDIR", "--memory"]);
    succeeds(&info("1G"));
}

#[test]
fn the_stored_field_stays_below_a_limit() {
    let tiny = Tiny::new();
    succeeds(&train(&tiny, "small", &["--steps", "40", "--max-bytes", "9k"]));
    let bytes = metrics(&tiny, "small")["bytes"].as_u64().unwrap();
    assert!(bytes <= 9_000, "{bytes}");
    refuses(&train(&tiny, "x", &["--capacity", "65"]), &["65", "power of two"]);
    refuses(&train(&tiny, "x", &["--method", "network", "--capacity", "64"]), &["--capacity", "grid"]);
    refuses(&train(&tiny, "x", &["--devices", "cpu,cpu"]), &["--devices", "--method network"]);
}

#[test]
fn depth_maps_supervise_it_too() {
    let tiny = Tiny::new();
    succeeds(&train(&tiny, "depth", &["--steps", "100", "--supervision", "depth", "--capacity", "64"]));
    let iou = metrics(&tiny, "depth")["shape"]["volume_iou"].as_f64().unwrap();
    assert!(iou > 0.85, "{iou}");
}
