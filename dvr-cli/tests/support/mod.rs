//! A tiny scene, and the binary.
#![allow(dead_code)] // each test binary uses its part

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use dvr_core::mesh::{TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};
use tempfile::TempDir;

/// A folder with a torus rendered from twelve sides at 24 pixels.
pub struct Tiny {
    pub folder: TempDir,
}

impl Tiny {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let torus = TexturedMesh { mesh: shapes::torus(1.0, 0.45, 32, 16), ..TexturedMesh::default() };
        let config = SynthConfig {
            views: 12,
            width: 24,
            height: 24,
            surface_points: 2000,
            occupancy_points: 1000,
            ..SynthConfig::default()
        };
        render_dataset(&torus, "torus", "rings", folder.path(), &config, &|_, _| ()).unwrap();
        Self { folder }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn scene(&self) -> PathBuf {
        self.path("rings/torus")
    }

    /// `dvr train` with a network that is small enough for a test, with more arguments.
    pub fn train(&self, out: &str, more: &[&str]) -> Output {
        let (scene, out) = (self.scene(), self.path(out));
        let mut args = vec!["train", text(&scene), "--out", text(&out), "--steps", "24", "--resolution", "32"];
        args.extend(SMALL);
        args.extend(more);
        dvr(&args)
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

/// Asserts exit code 2 and a one-line message that holds all of `parts`.
pub fn refuses(output: &Output, parts: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(!error.contains("panicked"), "{error}");
    for part in parts {
        assert!(error.contains(part), "{part:?} is missing in: {error}");
    }
}
