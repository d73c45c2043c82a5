//! `--backend gpu` from end to end, and the messages where there is none.

use std::process::{Command, Output};

use crate::support::{Corpus, Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::{Mesh, read_mesh};
use dvr_tests::{largest, test_with};
use glam::Vec3;

/// Runs the binary where no Vulkan driver is to be found.
fn without_driver(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dvr"));
    command.args(args).env("VK_DRIVER_FILES", "/nowhere").env("VK_ICD_FILENAMES", "/nowhere");
    command.output().unwrap()
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_driver_the_cpu_is_listed_and_the_gpu_refused_with_a_hint() {
    let listed = succeeds(&without_driver(&["devices"]));
    assert!(listed.starts_with("cpu") && !listed.contains("gpu:"), "{listed}");
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("refused"));
    let train = ["train", text(&scene), "--out", text(&out), "--method", "network", "--backend", "gpu"];
    let refused = without_driver(&train);
    refuses(&refused, &["was found", "--backend cpu"]);
    assert!(!out.exists(), "nothing half-written");
}

#[test]
fn a_number_that_no_adapter_has_is_refused() {
    let tiny = Tiny::new();
    succeeds(&tiny.train("run", &[]));
    let run = tiny.path("run");
    let mesh = tiny.path("mesh.ply");
    refuses(&dvr(&["mesh", text(&run), "--out", text(&mesh), "--backend", "gpu:77"]), &["--backend cpu"]);
    refuses(&dvr(&["mesh", text(&run), "--out", text(&mesh), "--backend", "gpu:one"]), &["dvr devices"]);
}

#[test_with(gpu)]
fn the_whole_job_runs_on_a_gpu() {
    let listed = succeeds(&dvr(&["devices"]));
    assert!(listed.contains("gpu:0"), "{listed}");
    let tiny = Tiny::new();
    // A step takes some 11 MB; if all were done at once, validations and the mesh would take more than is allowed.
    // Few steps: each is slow on a software adapter.
    let few = ["--steps", "8", "--set", "hull.warm_start_steps=30"];
    let there = ["--backend", "gpu", "--set", "model.blocks=2", "--memory", "24M"];
    let trained = tiny.train("run", &[few.as_slice(), &there].concat());
    let report = succeeds(&trained);
    assert!(report.contains("mesh:"), "{report}");
    let said = String::from_utf8_lossy(&trained.stderr);
    assert!(said.contains("computing on gpu:0"), "{said}");
    // What was trained there can be used here, and the other way round.
    let (run, mesh) = (tiny.path("run"), tiny.path("mesh.ply"));
    succeeds(&dvr(&["mesh", text(&run), "--out", text(&mesh), "--resolution", "16"]));
    let figures = succeeds(&dvr(&["eval", text(&run), "--backend", "gpu", "--resolution", "16"]));
    assert!(figures.contains("PSNR"), "{figures}");
}

#[test_with(gpu)]
fn a_model_of_many_objects_is_trained_and_meshed_on_a_gpu() {
    let corpus = Corpus::new();
    let trained = corpus.train("there", &["--backend", "gpu", "--steps", "4", "--no-report", "--memory", "100M"]);
    assert!(succeeds(&trained).contains("trained 4 steps"));
    assert!(String::from_utf8_lossy(&trained.stderr).contains("computing on gpu:0"));
    let (there, picture) = (corpus.path("there"), corpus.data().join("rings/o0/image/0000.png"));
    assert!(there.join("last.ckpt").is_file());

    // One that has learned some shape, asked on both.
    succeeds(&corpus.train("shapes", &["--supervision", "occupancy", "--steps", "80", "--no-report"]));
    let run = corpus.path("shapes");
    let [here, there] = ["cpu", "gpu"].map(|backend| {
        let out = corpus.path(backend);
        let args = ["predict", text(&run), text(&picture), "--out", text(&out), "--resolution", "16"];
        let said = succeeds(&dvr(&[&args[..], &["--backend", backend]].concat()));
        assert!(said.contains("1 of 1 pictures"), "{said}");
        read_mesh(out.join("0000.ply")).unwrap().mesh
    });
    let extent = |mesh: &Mesh| {
        let (low, high) = mesh.vertices.iter().fold((Vec3::MAX, Vec3::MIN), |(a, b), &v| (a.min(v), b.max(v)));
        (low, high)
    };
    let ((low, high), (low_there, high_there)) = (extent(&here), extent(&there));
    assert!(
        low.distance(low_there) < 1e-3 && high.distance(high_there) < 1e-3,
        "{low} {low_there} {high} {high_there}"
    );
    assert!(here.faces.len().abs_diff(there.faces.len()) * 50 < here.faces.len() + 50);
}

#[test_with(gpu)]
fn a_step_that_exceeds_the_allowed_memory_is_refused_with_one_that_fits() {
    let tiny = Tiny::new();
    let out = tiny.path("refused");
    let large = ["--backend", "gpu", "--set", "rays=4096", "--memory", "18M"];
    let refused = tiny.train("refused", &large);
    refuses(&refused, &["a step takes about", "18 MB are allowed", "--set rays=", "--memory"]);
    refuses(&tiny.train("refused", &["--backend", "gpu", "--memory", "0"]), &["0 MB are allowed", "--backend cpu"]);
    assert!(!out.exists(), "nothing half-written");
    // On the CPU it means the process.
    succeeds(&tiny.train("run", &["--memory", "1G"]));
}

#[test_with(gpu)]
fn the_grid_method_trains_and_renders_on_a_gpu() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("grid"));
    let small = ["--steps", "12", "--capacity", "32", "--set", "rays=128", "--resolution", "32", "--no-report"];
    let mut train = vec!["train", text(&scene), "--out", text(&out), "--backend", "gpu"];
    train.extend(small);
    let output = dvr(&train);
    let report = succeeds(&output);
    assert!(report.contains("mesh:"), "{report}");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("computing on gpu:0") && !said.contains("computed on the CPU"), "{said}");
    let [here, there] = ["cpu", "gpu"].map(|backend| {
        let (mesh, frames) = (tiny.path(&format!("{backend}.ply")), tiny.path(backend));
        let memory = if backend == "gpu" { "50M" } else { "1G" };
        let with = ["--backend", backend, "--memory", memory];
        succeeds(&dvr(&[&["mesh", text(&out), "--out", text(&mesh), "--resolution", "16"][..], &with].concat()));
        let render = ["render", text(&out), "--out", text(&frames), "--frames", "2", "--size", "32"];
        succeeds(&dvr(&[&render[..], &with].concat()));
        (read_mesh(&mesh).unwrap().mesh, image::open(frames.join("orbit_0001.png")).unwrap().into_rgb8())
    });
    assert_eq!(here.0.faces, there.0.faces);
    let apart = largest(here.0.vertices.iter().zip(&there.0.vertices).map(|(a, b)| a.distance(*b)));
    assert!(apart < 1e-4, "{apart}");
    let differing =
        here.1.pixels().zip(there.1.pixels()).filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 1));
    assert!(differing.count() <= 2, "a pixel or two on the outline may go either way");

    // The field alone takes more than this.
    let mesh = tiny.path("refused.ply");
    let refused = dvr(&["mesh", text(&out), "--out", text(&mesh), "--backend", "gpu", "--memory", "100k"]);
    refuses(&refused, &["values of nodes", "0.10 MB are allowed", "--memory"]);
    assert!(!mesh.exists(), "nothing half-written");
}

#[test]
fn the_visual_hull_notes_that_it_stays_on_the_cpu() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("hull"));
    let output = dvr(&[
        "train",
        text(&scene),
        "--out",
        text(&out),
        "--method",
        "hull",
        "--resolution",
        "32",
        "--backend",
        "gpu",
    ]);
    succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("computed on the CPU"), "{said}");
}
