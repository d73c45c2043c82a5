//! A dataset of many objects from meshes to tables, on two categories of five small objects that the test renders itself.

mod support;

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use dvr_core::mesh::{Mesh, TexturedMesh, shapes, write_mesh};
use glam::Vec3;
use support::{Tiny, dvr, refuses, succeeds, text};
use tempfile::TempDir;

/// Ten objects with six views each at 24 pixels.
struct Corpus {
    folder: TempDir,
}

impl Corpus {
    fn new() -> Self {
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

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn data(&self) -> PathBuf {
        self.path("data")
    }

    /// The arguments of `dvr train` with a model that is small enough for a test.
    fn arguments(&self, out: &str, more: &[&str]) -> Vec<String> {
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

    fn train(&self, out: &str, more: &[&str]) -> Output {
        let args = self.arguments(out, more);
        dvr(&args.iter().map(String::as_str).collect::<Vec<_>>())
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    /// Steps and losses of a run, without the seconds.
    fn curve(&self, run: &str) -> Vec<Vec<String>> {
        let csv = self.read(&format!("{run}/metrics.csv"));
        let names: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
        let row = |line: &str| {
            let cells = names.iter().zip(line.split(',')).filter(|(name, _)| !name.ends_with("seconds"));
            cells.map(|(_, cell)| cell.to_owned()).collect()
        };
        csv.lines().map(row).collect()
    }
}

#[test]
fn a_dataset_becomes_a_model_that_is_measured_on_unseen_objects_beside_its_baselines() {
    let corpus = Corpus::new();
    let output = corpus.train("run", &[]);
    let said = succeeds(&output);
    assert!(said.contains("silhouette IoU") && said.contains("6 objects"), "{said}");
    let described = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(described.contains("a dataset of many objects") && described.contains("2 for testing"), "{described}");
    let run = corpus.path("run");
    for file in ["last.ckpt", "best.ckpt", "config.json", "metrics.csv", "metrics.json", "preview.png", "report.html"] {
        assert!(run.join(file).is_file(), "{file}");
    }

    // Whole, in parts, and taken up where it was stopped: the same figures.
    let coarse = ["--resolution", "16", "--object-views", "2"];
    let eval = |more: &[&str]| dvr(&[&["eval", text(&run)], &coarse[..], more].concat());
    let table = succeeds(&eval(&[]));
    assert!(table.contains("| balls | 1 |") && table.contains("Chamfer-L1 (x10)") && table.contains("PSNR"), "{table}");
    let whole = corpus.read("run/eval_test/summary.csv");
    assert_eq!(whole.lines().count(), 5, "a header, two categories and two means: {whole}");
    let parts = corpus.path("parts");
    let mut files = Vec::new();
    for part in ["1/2", "2/2"] {
        succeeds(&eval(&["--out", text(&parts), "--shard", part]));
        files.push(parts.join(format!("objects-{}.jsonl", part.replace('/', "-of-"))));
    }
    let joined = corpus.path("joined");
    succeeds(&dvr(&["eval", "--merge", text(&files[0]), text(&files[1]), "--out", text(&joined)]));
    assert_eq!(corpus.read("joined/summary.csv"), whole);
    let results = run.join("eval_test/objects.jsonl");
    let lines = corpus.read("run/eval_test/objects.jsonl");
    std::fs::write(&results, &lines[..lines.len() - 30]).unwrap();
    std::fs::remove_file(run.join("eval_test/summary.csv")).unwrap();
    let again = eval(&[]);
    succeeds(&again);
    assert!(String::from_utf8_lossy(&again.stderr).contains("1/1"), "one object was left to do");
    assert_eq!(corpus.read("run/eval_test/summary.csv"), whole);
    refuses(&eval(&["--seed", "1"]), &["objects.jsonl", "seed 0", "--out"]);

    // Beside the baselines.
    let data = corpus.data();
    let mut files = vec![results];
    for baseline in ["mean-shape", "nearest-picture"] {
        let out = corpus.path(baseline);
        let args = ["eval", "--baseline", baseline, "--data", text(&data), "--out", text(&out)];
        let table = succeeds(&dvr(&[&args[..], &coarse].concat()));
        assert!(table.contains("| rings | 1 |"), "{table}");
        files.push(out.join("objects.jsonl"));
    }
    let files: Vec<&str> = files.iter().map(|file| text(file)).collect();
    let out = corpus.path("beside");
    let table = succeeds(&dvr(&[&["eval", "--out", text(&out), "--merge"], &files[..]].concat()));
    assert!(table.contains("| category | objects | run | mean shape | nearest picture |"), "{table}");
    refuses(&dvr(&["eval", "--out", text(&out), "--merge", files[0], files[0]]), &["objects.jsonl", "earlier"]);

    // What such a run is not.
    refuses(&dvr(&["mesh", text(&run)]), &["dvr predict"]);
}

#[test]
fn a_killed_run_resumes_as_if_it_had_not_been() {
    let corpus = Corpus::new();
    let more = ["--supervision", "depth", "--steps", "40"];
    succeeds(&corpus.train("whole", &more));
    let args = corpus.arguments("parts", &more);
    let mut child = Command::new(env!("CARGO_BIN_EXE_dvr"));
    let mut child = child.args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let parts = corpus.path("parts");
    while !parts.join("last.ckpt").exists() {
        std::thread::sleep(Duration::from_millis(5));
        assert!(child.try_wait().unwrap().is_none_or(|status| status.success()), "it died of something else");
    }
    child.kill().unwrap();
    child.wait().unwrap();
    succeeds(&dvr(&["train", "--resume", "--out", text(&parts)]));
    assert_eq!(corpus.curve("parts"), corpus.curve("whole"));
    assert!(corpus.curve("whole").len() > 10);
}

#[test]
fn broken_objects_are_left_out_named_once_and_counted() {
    let corpus = Corpus::new();
    let train = corpus.read("data/rings/train.lst");
    let test = corpus.read("data/rings/test.lst");
    for (list, file) in [(&train, "cameras.npz"), (&test, "image/0002.png")] {
        let object = list.lines().next().unwrap();
        std::fs::write(corpus.data().join("rings").join(object).join(file), "broken").unwrap();
    }
    let test_object = test.lines().next().unwrap();
    for view in 0..6 {
        let image = corpus.data().join("rings").join(test_object).join(format!("image/{view:04}.png"));
        std::fs::write(image, "broken").unwrap();
    }
    let output = corpus.train("run", &[]);
    let said = succeeds(&output);
    assert!(said.contains("1 object(s) could not be used"), "{said}");
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(notes.matches("is left out").count(), 1, "{notes}");
    assert!(corpus.read("run/metrics.json").contains("cameras.npz"));
    let run = corpus.path("run");
    let said = succeeds(&dvr(&["eval", text(&run), "--resolution", "16"]));
    assert!(said.contains("1 object(s) could not be measured") && !said.contains("| rings |"), "{said}");
}

#[test]
fn three_dimensional_supervision_and_learned_codes_train_too() {
    let corpus = Corpus::new();
    let more = ["--supervision", "occupancy", "--set", "encoder={\"kind\":\"codes\"}", "--categories", "rings"];
    let said = succeeds(&corpus.train("run", &more));
    assert!(said.contains("3 objects"), "{said}");
    let run = corpus.path("run");
    refuses(&dvr(&["eval", text(&run), "--resolution", "16"]), &["--split train"]);
    let table = succeeds(&dvr(&["eval", text(&run), "--resolution", "16", "--split", "train"]));
    assert!(table.contains("| rings | 3 |"), "{table}");
}

#[test]
fn what_makes_no_sense_is_refused_before_anything_is_written() {
    let corpus = Corpus::new();
    let data = corpus.data();
    refuses(&corpus.train("x", &["--method", "fast"]), &["--method network"]);
    refuses(&corpus.train("x", &["--categories", "cubes"]), &["`cubes`", "balls, rings"]);
    refuses(&corpus.train("x", &["--set", "views=0"]), &["views"]);
    refuses(&corpus.train("x", &["--downscale", "2"]), &["--downscale", "single scenes"]);
    refuses(&corpus.train("x", &["--inputs", text(&corpus.path("nowhere"))]), &["nowhere"]);
    assert!(!corpus.path("x/last.ckpt").exists());
    let out = corpus.path("out");
    refuses(&dvr(&["eval", "--baseline", "mean-shape", "--data", text(&data)]), &["--out"]);
    refuses(&dvr(&["eval", "--merge", text(&data), "--out", text(&out)]), &["data"]);
    let args = ["eval", "--baseline", "mean-shape", "--data", text(&data), "--out", text(&out)];
    refuses(&dvr(&[&args[..], &["--shard", "3/2"]].concat()), &["3/2"]);

    let tiny = Tiny::new();
    refuses(&tiny.train("x", &["--supervision", "occupancy"]), &["datasets of many objects"]);
    refuses(&tiny.train("x", &["--categories", "rings"]), &["single scene"]);
    succeeds(&tiny.train("run", &[]));
    refuses(&dvr(&["eval", text(&tiny.path("run")), "--split", "test"]), &["--split", "single scene"]);
}
