//! End to end: the commands one after the other, as a user gives them, on a scene that takes seconds.

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::{SMALL, Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::read_mesh;
use safetensors::SafeTensors;

#[test]
fn a_scene_becomes_a_watertight_mesh_with_preview_figures_renders_and_export() {
    let tiny = Tiny::new();
    let info = succeeds(&dvr(&["info", text(&tiny.scene())]));
    assert!(info.contains("10 to train on, 1 for validation, 1 for testing") && info.contains("24x24"), "{info}");
    let json = succeeds(&dvr(&["info", text(&tiny.scene()), "--json"]));
    assert!(json.contains("\"hull_share_of_cube\""));

    let out = succeeds(&tiny.train("run", &["--seed", "3"]));
    assert!(out.contains("Chamfer-L1") && out.contains("volume IoU"), "{out}");
    has_its_files(&tiny.path("run"));
    has_closed_meshes(&tiny.path("run"));
    is_evaluated(&tiny);
    is_rendered(&tiny);

    let run = tiny.path("run");
    let obj = tiny.path("again.obj");
    succeeds(&dvr(&["mesh", text(&run), "--out", text(&obj), "--resolution", "24"]));
    assert!(!read_mesh(&obj).unwrap().mesh.is_empty());
    let exported = tiny.path("net.safetensors");
    succeeds(&dvr(&["export", text(&run), "--out", text(&exported)]));
    assert!(exported.is_file());
}

fn has_its_files(run: &Path) {
    let checkpoints = ["last.ckpt", "best.ckpt"];
    let results = ["config.json", "metrics.csv", "metrics.json", "mesh.ply", "mesh.glb", "preview.png", "report.html"];
    for file in checkpoints.iter().chain(&results) {
        assert!(run.join(file).is_file(), "{file}");
    }
    let metrics = std::fs::read_to_string(run.join("metrics.json")).unwrap();
    assert!(metrics.contains("\"chamfer_l1\"") && metrics.contains("\"test_mesh\""));
    assert!(std::fs::read_to_string(run.join("metrics.csv")).unwrap().lines().count() >= 4);
}

fn has_closed_meshes(run: &Path) {
    for file in ["mesh.ply", "mesh.glb"] {
        let textured = read_mesh(run.join(file)).unwrap();
        let has_texture = textured.materials.iter().any(|material| material.texture.is_some());
        let mesh = textured.mesh;
        assert_eq!((has_texture, mesh.colors.is_some()), (file == "mesh.glb", file == "mesh.ply"), "{file}");
        // Along the seams of its texture a GLB has vertices twice.
        let mut places = HashMap::new();
        let place = |i: u32| mesh.vertices[i as usize].to_array().map(f32::to_bits);
        let mut welded = |i: u32| {
            let next = places.len() as u32;
            *places.entry(place(i)).or_insert(next)
        };
        let faces: Vec<[u32; 3]> = mesh.faces.iter().map(|face| face.map(&mut welded)).collect();
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for face in &faces {
            for k in 0..3 {
                *edges.entry((face[k], face[(k + 1) % 3])).or_default() += 1;
            }
        }
        let closed = edges.iter().all(|(&(a, b), &n)| n == 1 && edges.get(&(b, a)) == Some(&1));
        assert!(closed && !mesh.faces.is_empty(), "{file}: every edge has two faces, in opposite directions");
    }
    // The torus spans 2.9 of its own units: the mesh is in the scene's coordinates, not in the unit cube.
    let (low, high) = read_mesh(run.join("mesh.ply")).unwrap().mesh.bounds().unwrap();
    assert!(((high - low).max_element() - 2.9).abs() < 0.4, "{low} {high}");
}

fn is_evaluated(tiny: &Tiny) {
    let (run, json) = (tiny.path("run"), tiny.path("eval.json"));
    let eval = ["eval", text(&run), "--resolution", "32", "--samples", "32", "--json", text(&json)];
    let table = succeeds(&dvr(&eval));
    assert!(table.contains("PSNR dB") && table.contains("floor"), "{table}");
    assert!(json.is_file());
    let table = succeeds(&dvr(&["eval", text(&run.join("mesh.ply")), "--data", text(&tiny.scene())]));
    assert!(table.contains("Chamfer-L1"), "{table}");
}

fn is_rendered(tiny: &Tiny) {
    let (run, frames) = (tiny.path("run"), tiny.path("frames"));
    let render = ["render", text(&run), "--out", text(&frames), "--samples", "16"];
    succeeds(&dvr(&[&render[..], &["--frames", "3", "--size", "24", "--exr", "--normals"]].concat()));
    for file in ["orbit_0002.png", "orbit_0002.exr", "orbit_0002_depth.exr", "orbit_0002_normal.png", "turntable.gif"] {
        assert!(frames.join(file).is_file(), "{file}");
    }
    let others = [&render[..], &["--cameras", "dataset"]].concat();
    refuses(&dvr(&others), &["already holds a set of renders", "--overwrite"]);
    succeeds(&dvr(&[&others[..], &["--overwrite"]].concat()));
    assert!(frames.join("0011.png").is_file() && !frames.join("turntable.gif").exists());
}

#[test]
fn the_demo_of_the_readme_becomes_a_mug() {
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("assets").join("scenes/mug/mug");
    let folder = tempfile::tempdir().unwrap();
    let (run, json) = (folder.path().join("first"), folder.path().join("eval.json"));
    succeeds(&dvr(&["train", text(&scene), "--out", text(&run)]));
    for file in ["mesh.ply", "mesh.glb", "report.html", "preview.png", "scene.dvr", "metrics.json", "last.ckpt"] {
        assert!(run.join(file).is_file(), "{file}");
    }
    succeeds(&dvr(&["eval", text(&run), "--json", text(&json)]));
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let chamfer = report["shape"]["surface"]["chamfer_l1"].as_f64().unwrap();
    let views = report["views"].as_array().unwrap();
    let psnr = views.iter().map(|view| view["psnr"].as_f64().unwrap()).sum::<f64>() / views.len() as f64;
    println!("Chamfer-L1 {chamfer:.4}, {psnr:.2} dB");
    // The hull, whose mouth is closed, has .024 and an IoU of .38.
    let iou = report["shape"]["volume_iou"].as_f64().unwrap();
    assert!(chamfer < 0.018 && iou > 0.55 && psnr > 23.0, "{chamfer} {iou} {psnr}");
}

#[test]
fn a_stopped_run_resumes_to_the_same_parameters_as_an_unbroken_one() {
    let tiny = Tiny::new();
    succeeds(&tiny.train("whole", &[]));
    succeeds(&tiny.train("parts", &["--time", "0s"]));
    let parts = tiny.path("parts");
    let rows = || std::fs::read_to_string(parts.join("metrics.csv")).unwrap().lines().count();
    let before = rows();
    succeeds(&dvr(&["train", "--resume", "--out", text(&parts), "--resolution", "32"]));
    assert!(rows() > before, "the curves go on");
    let export = |run: &str| {
        let file = tiny.path(&format!("{run}.safetensors"));
        let checkpoint = tiny.path(run).join("last.ckpt");
        succeeds(&dvr(&["export", text(&checkpoint), "--out", text(&file)]));
        let bytes = std::fs::read(file).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let tensors = file.iter().map(|(name, tensor)| (name.to_owned(), tensor.data().to_vec()));
        tensors.collect::<BTreeMap<_, _>>()
    };
    assert!(export("whole") == export("parts"), "bit for bit");
}

#[test]
fn ctrl_c_saves_and_leaves_with_130() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("run"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_dvr"))
        .args(["train", text(&scene), "--out", text(&out), "--steps", "1000000"])
        .args(SMALL)
        .stderr(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let last = out.join("last.ckpt");
    while !last.exists() {
        assert!(child.try_wait().unwrap().is_none(), "the run goes on");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let status = child.wait().unwrap();
    let mut error = String::new();
    child.stderr.take().unwrap().read_to_string(&mut error).unwrap();
    assert_eq!(status.code(), Some(130), "{error}");
    assert!(error.contains("--resume"), "{error}");
    assert!(succeeds(&dvr(&["export", text(&last), "--out", text(&tiny.path("x.safetensors"))])).contains("wrote"));
}

#[test]
fn meshes_become_a_dataset_that_trains() {
    let tiny = Tiny::new();
    let mesh = dvr_core::mesh::shapes::cuboid(glam::Vec3::ZERO, glam::Vec3::new(1.0, 2.0, 3.0));
    std::fs::create_dir_all(tiny.path("meshes/boxes")).unwrap();
    dvr_core::mesh::write_mesh(tiny.path("meshes/boxes/a.ply"), &mesh).unwrap();
    std::fs::write(tiny.path("meshes/boxes/broken.ply"), "ply\nnonsense").unwrap();
    let (meshes, data) = (tiny.path("meshes"), tiny.path("data"));
    let output = dvr(&["synth", text(&meshes), "--out", text(&data), "--views", "6", "--size", "16"]);
    let out = succeeds(&output);
    assert!(out.contains("rendered 1 object(s)") && out.contains("1 skipped"), "{out}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("broken.ply"));
    assert!(
        succeeds(&dvr(&["info", text(&data.join("boxes/a"))]))
            .contains("5 to train on, 0 for validation, 1 for testing")
    );
    refuses(&dvr(&["synth", text(&tiny.path("nowhere")), "--out", text(&data)]), &["nowhere"]);
}
