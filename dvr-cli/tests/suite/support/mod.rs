//! A tiny scene, a tiny dataset of objects, and the binary.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use dvr_core::mesh::{Mesh, TexturedMesh, shapes, write_mesh};
use dvr_core::synth::{SynthConfig, render_dataset};
use glam::Vec3;
use tempfile::TempDir;

/// A folder with a torus rendered from twelve sides at 24 pixels.
pub struct Tiny {
    pub folder: TempDir,
}

impl Tiny {
    pub fn new() -> Self {
        Self::rendered(shapes::torus(1.0, 0.45, 32, 16), 12, 24)
    }

    /// The same of another mesh, with more views or pixels.
    pub fn rendered(mesh: Mesh, views: usize, pixels: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let object = TexturedMesh { mesh, ..TexturedMesh::default() };
        let config = SynthConfig {
            views,
            width: pixels,
            height: pixels,
            surface_points: 2000,
            occupancy_points: 1000,
            ..SynthConfig::default()
        };
        render_dataset(&object, "torus", "rings", folder.path(), &config, &|_, _| ()).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn scene(&self) -> PathBuf {
        self.path("rings/torus")
    }

    /// What `dvr eval` measures of a mesh against the scene, without rendering.
    pub fn volume_iou(&self, mesh: &Path) -> f64 {
        let (scene, json) = (self.scene(), self.path("eval.json"));
        succeeds(&dvr(&[
            "eval",
            text(mesh),
            "--data",
            text(&scene),
            "--no-views",
            "--json",
            text(&json),
            "--overwrite",
        ]));
        let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
        report["shape"]["volume_iou"].as_f64().unwrap()
    }

    /// `dvr train` with a network that is small enough for a test, with more arguments.
    pub fn train(&self, out: &str, more: &[&str]) -> Output {
        let (scene, out) = (self.scene(), self.path(out));
        let mut args = vec!["train", text(&scene), "--out", text(&out), "--resolution", "32"];
        if !more.contains(&"--steps") {
            args.extend(["--steps", "24"]);
        }
        args.extend(SMALL);
        args.extend(more);
        dvr(&args)
    }
}

/// Ten objects with six views each at 24 pixels.
pub struct Corpus {
    folder: TempDir,
}

impl Corpus {
    pub fn new() -> Self {
        let corpus = Self { folder: tempfile::tempdir().unwrap() };
        for i in 0..5 {
            let shapes = [("balls", shapes::icosphere(2, 1.0)), ("rings", shapes::torus(1.0, 0.4, 24, 12))];
            for (category, mesh) in shapes {
                let stretch = Vec3::new(1.0, 0.5 + 0.2 * i as f32, 1.0);
                let vertices = mesh.vertices.iter().map(|vertex| *vertex * stretch).collect();
                let textured =
                    TexturedMesh { mesh: Mesh { vertices, normals: None, ..mesh }, ..TexturedMesh::default() };
                let folder = corpus.path(&format!("meshes/{category}"));
                std::fs::create_dir_all(&folder).unwrap();
                write_mesh(folder.join(format!("o{i}.ply")), &textured.mesh).unwrap();
            }
        }
        let settings = corpus.path("synth.json");
        std::fs::write(&settings, r#"{"surface_points": 1500, "occupancy_points": 3000}"#).unwrap();
        let (meshes, data) = (corpus.path("meshes"), corpus.data());
        let args = ["synth", text(&meshes), "--out", text(&data), "--views", "6", "--size", "24"];
        succeeds(&dvr(&[&args[..], &["--config", text(&settings)]].concat()));
        corpus
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn data(&self) -> PathBuf {
        self.path("data")
    }

    /// The arguments of `dvr train` with a model that is small enough for a test.
    pub fn arguments(&self, out: &str, more: &[&str]) -> Vec<String> {
        let (data, out) = (self.data(), self.path(out));
        let small =
            ["encoder.kind=convolutional", "encoder.image_size=63", "encoder.width=2", "objects=4", "points=64"];
        let smaller = ["model.hidden=16", "model.code_dim=8", "model.octaves=1", "rays=32", "validate_objects=2"];
        let pace = ["validate_every=4", "checkpoint_every=4"];
        let mut args = vec!["train", text(&data), "--out", text(&out)];
        if !more.contains(&"--steps") {
            args.extend(["--steps", "12"]);
        }
        args.extend(small.iter().chain(&smaller).chain(&pace).flat_map(|setting| ["--set", *setting]));
        args.extend(more);
        args.into_iter().map(str::to_owned).collect()
    }

    pub fn train(&self, out: &str, more: &[&str]) -> Output {
        let args = self.arguments(out, more);
        dvr(&args.iter().map(String::as_str).collect::<Vec<_>>())
    }

    pub fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    /// Steps and losses of a run, without the seconds.
    pub fn curve(&self, run: &str) -> Vec<Vec<String>> {
        let csv = self.read(&format!("{run}/metrics.csv"));
        let names: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
        let row = |line: &str| {
            let cells = names.iter().zip(line.split(',')).filter(|(name, _)| !name.ends_with("seconds"));
            cells.map(|(_, cell)| cell.to_owned()).collect()
        };
        csv.lines().map(row).collect()
    }
}

/// Settings of a network for tests.
pub const SMALL: [&str; 14] = [
    "--method",
    "network",
    "--set",
    "model.hidden=32",
    "--set",
    "model.octaves=2",
    "--set",
    "rays=128",
    "--set",
    "hull.warm_start_steps=60",
    "--set",
    "validate_every=8",
    "--set",
    "checkpoint_every=8",
];

pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs the binary to its end.
pub fn dvr(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_dvr")).args(args).output().unwrap()
}

/// Asserts success and returns standard output.
pub fn succeeds(output: &Output) -> String {
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{:?}\n{error}", output.status);
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Copies pictures, masks and cameras of the demo scene into a folder, where they may be changed.
pub fn copy_demo(folder: &Path) {
    let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/mug/mug");
    for part in ["image", "mask"] {
        std::fs::create_dir_all(folder.join(part)).unwrap();
        for file in std::fs::read_dir(demo.join(part)).unwrap() {
            let file = file.unwrap();
            std::fs::copy(file.path(), folder.join(part).join(file.file_name())).unwrap();
        }
    }
    std::fs::copy(demo.join("cameras.npz"), folder.join("cameras.npz")).unwrap();
}

/// Asserts exit code 2 and a one-line message that holds all of `parts`.
pub fn refuses(output: &Output, parts: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(!error.contains("panicked"), "{error}");
    for part in parts {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
}

/// A COLMAP that does what a script says.
#[cfg(unix)]
pub fn script(path: &Path, lines: &str) {
    use std::os::unix::fs::PermissionsExt;
    std::fs::write(path, format!("#!/bin/sh\n{lines}\n")).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}
