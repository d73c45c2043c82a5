//! A dataset of many objects from meshes to tables, on two categories of five small objects that the test renders
//! itself.

use std::process::{Command, Stdio};
use std::time::Duration;

use crate::support::{Corpus, Tiny, dvr, refuses, succeeds, text};
use burn::tensor::Device;
use dvr_model::{DecoderConfig, EncoderConfig, ImageModelConfig, to_safetensors};
use dvr_tests::{Entry, max_difference, seeded, write_pytorch};
use safetensors::{Dtype, SafeTensors};

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

    let object = corpus.read("data/rings/test.lst").lines().next().unwrap().to_owned();
    // Shapes that are wanted beside the figures are made where they are not there yet.
    let shapes = run.join("eval_test/shapes");
    let kept = || succeeds(&eval(&["--keep-shapes"]));
    assert!(!shapes.exists() && kept() == table);
    let ring = shapes.join(format!("rings/{object}.ply"));
    assert!(!dvr_core::mesh::read_mesh(&ring).unwrap().mesh.faces.is_empty() && shapes.join("balls").is_dir());
    std::fs::remove_file(&ring).unwrap();
    assert!(kept() == table && ring.is_file());

    // Rows say what they were made of; one whose object has changed is made again.
    assert_eq!(corpus.read("run/eval_test/objects.jsonl").matches("\"program\":\"dvr ").count(), 2);
    assert!(corpus.read("run/eval_test/summary.md").contains("dvr 0"), "the table says where it comes from");
    let images = corpus.data().join("rings").join(&object).join("image");
    let original = std::fs::read(images.join("0001.png")).unwrap();
    std::fs::copy(images.join("0002.png"), images.join("0001.png")).unwrap();
    let again = eval(&[]);
    succeeds(&again);
    let said = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(said.contains("1 object(s) are measured again") && said.contains("evaluating objects 1/1"), "{said}");
    std::fs::write(images.join("0001.png"), original).unwrap();
    succeeds(&eval(&[]));
    assert_eq!(corpus.read("run/eval_test/summary.csv"), whole, "the same object, the same figures");
    // A shape that is there from other figures is made again; a file of the user's is not touched.
    let again = eval(&["--keep-shapes"]);
    assert!(succeeds(&again) == table);
    assert!(String::from_utf8_lossy(&again.stderr).contains("evaluating objects 1/1"), "the other is current");
    let other = corpus.path("other");
    std::fs::create_dir_all(other.join("shapes/rings")).unwrap();
    let args = ["eval", text(&run), "--split", "test", "--resolution", "16", "--out", text(&other)];
    refuses(&dvr(&[&args[..], &["--keep-shapes"]].concat()), &["other"]);
    std::fs::remove_dir_all(other.join("shapes")).unwrap();
    succeeds(&dvr(&args));
    let own = other.join(format!("shapes/rings/{object}.ply"));
    std::fs::create_dir_all(own.parent().unwrap()).unwrap();
    std::fs::write(&own, "mine").unwrap();
    refuses(&dvr(&[&args[..], &["--keep-shapes"]].concat()), &[&format!("{object}.ply")]);
    assert_eq!(std::fs::read_to_string(&own).unwrap(), "mine");

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
fn systems_of_other_papers_train_measure_predict_and_export_as_dvr_does() {
    let corpus = Corpus::new();
    let data = corpus.data();
    let object = corpus.read("data/rings/test.lst").lines().next().unwrap().to_owned();
    let picture = data.join("rings").join(object).join("image/0001.png");
    let small = ["encoder.image_size=63", "encoder.width=2", "objects=4", "validate_objects=2", "validate_every=2"];
    let small: Vec<&str> = small.iter().flat_map(|setting| ["--set", *setting]).collect();
    for (system, more) in [
        ("r2n2", ["decoder.width=4", "code_dim=8"]),
        ("psgn", ["points=64", "code_dim=8"]),
        ("atlasnet", ["points=64", "code_dim=8"]),
        ("pixel2mesh", ["encoder.channels=4", "points=64"]),
        ("drc", ["rays=16", "code_dim=8"]),
        ("softras", ["views=1", "code_dim=8"]),
        ("onet", ["points=16", "model.hidden=8"]),
    ] {
        let run = corpus.path(system);
        let train =
            |steps: &str, more: &[&str]| dvr(&[&["train", "--out", text(&run), "--steps", steps], more].concat());
        let more = more.iter().flat_map(|setting| ["--set", *setting]);
        let method: Vec<&str> =
            [text(&data), "--method", system].into_iter().chain(more).chain(small.iter().copied()).collect();
        let said = succeeds(&train("3", &method));
        assert!(said.contains("6 objects"), "{system}: {said}");
        succeeds(&train("4", &["--resume"]));
        assert_eq!(corpus.curve(system).last().unwrap()[0], "4", "{system}");
        assert!(run.join("report.html").is_file() && run.join("preview.png").is_file(), "{system}");
        let table = succeeds(&dvr(&["eval", text(&run), "--resolution", "16", "--object-views", "1"]));
        let has_volume = !matches!(system, "psgn" | "atlasnet");
        assert!(table.contains("| rings | 1 |") && table.contains("Chamfer-L1 (x10)"), "{system}: {table}");
        assert_eq!(table.contains("volume IoU"), has_volume, "{system}: {table}");
        let at = dvr(&["eval", text(&run), "--resolution", "16", "--threshold", "0.3"]);
        match system {
            "r2n2" | "drc" | "onet" => assert!(succeeds(&at).contains("surface at 0.3"), "{system}"),
            _ => refuses(&at, &[system, "no occupancies"]),
        }
        refuses(&dvr(&["eval", text(&run), "--symmetry", "on"]), &["mirror", "--symmetry"]);
        let export = corpus.path(&format!("{system}.safetensors"));
        succeeds(&dvr(&["export", text(&run), "--out", text(&export)]));
        let bytes = std::fs::read(&export).unwrap();
        let names = SafeTensors::deserialize(&bytes).unwrap();
        assert!(names.names().iter().any(|name| name.starts_with("decoder.")), "{system}");
        let out = corpus.path(&format!("{system}_meshes"));
        let predicted = dvr(&["predict", text(&run), text(&picture), "--out", text(&out)]);
        // Voxels and fields after four steps may be alike everywhere, and have no surface; points, pieces and spheres have one.
        if !matches!(system, "r2n2" | "drc" | "onet") {
            succeeds(&predicted);
            assert!(out.join("0001.glb").is_file() && out.join("0001.ply").is_file(), "{system}");
        }
        refuses(&dvr(&["mesh", text(&run)]), &["dvr predict"]);
    }
    refuses(&corpus.train("x", &["--method", "psgn", "--supervision", "depth"]), &["psgn", "occupancy", "depth"]);
}

#[test]
fn the_local_encoder_sees_views_in_training_and_guesses_the_camera_of_other_pictures() {
    let corpus = Corpus::new();
    let train = |more: &[&str]| {
        let small = ["encoder.width=2", "encoder.channels=4", "objects=4", "rays=32", "validate_objects=2"];
        // What has learned nothing yet is on both sides of a half.
        let small = small.into_iter().chain(["model.hidden=16", "model.code_dim=8", "threshold=0.5"]);
        // Balls and rings are their own mirror images; hulls of six views are not.
        let small = small.chain(["mirror=x", "symmetry=on"]);
        let small: Vec<&str> = small.flat_map(|setting| ["--set", setting]).collect();
        let (data, run) = (corpus.data(), corpus.path("local"));
        dvr(&[&["train", text(&data), "--out", text(&run), "--steps", "4"], &small[..], more].concat())
    };
    let run = corpus.path("local");
    for kind in ["local-bn", "local"] {
        succeeds(&train(&["--overwrite", "--encoder", kind]));
        assert!(corpus.read("local/config.json").contains("\"channels\": 4"));
        let table = succeeds(&dvr(&["eval", text(&run), "--resolution", "16", "--object-views", "1"]));
        assert!(table.contains("Chamfer-L1 (x10)"), "{table}");
    }
    // Evaluation may doubt it.
    let doubted = succeeds(&dvr(&["eval", text(&run), "--resolution", "16", "--symmetry", "off"]));
    assert!(doubted.contains("symmetry off"), "{doubted}");
    let [found, doubted] = ["", "_symmetry_off"].map(|so| corpus.read(&format!("local/eval_test{so}/summary.csv")));
    assert_ne!(found, doubted);
    let object = corpus.read("data/rings/test.lst").lines().next().unwrap().to_owned();
    let picture = corpus.data().join("rings").join(object).join("image/0001.png");
    let out = corpus.path("local_meshes");
    let predict = |more: &[&str]| {
        let predict = ["predict", text(&run), text(&picture), "--out", text(&out), "--resolution", "16"];
        succeeds(&dvr(&[&predict, more].concat()));
        std::fs::read(out.join("0001.glb")).unwrap()
    };
    assert_ne!(predict(&[]), predict(&["--symmetry", "off"]));
    refuses(&train(&["--overwrite", "--encoder", "local", "--inputs", text(&corpus.data())]), &["--inputs", "local"]);
    refuses(&train(&["--overwrite", "--encoder", "vgg"]), &["vgg", "resnet18"]);
    assert!(run.join("last.ckpt").is_file(), "what was there is kept");
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
    assert!(said.contains("1 object(s) could not be measured") && said.contains("| rings | 0 of 1 |"), "{said}");
    // The advice for learned codes is for learned codes.
    std::fs::write(
        corpus.data().join("balls").join(corpus.read("data/balls/test.lst").trim()).join("cameras.npz"),
        "x",
    )
    .unwrap();
    let output = dvr(&["eval", text(&run), "--resolution", "16"]);
    refuses(&output, &["no object could be measured"]);
    assert!(!String::from_utf8_lossy(&output.stderr).contains("--split train"));
}

#[test]
fn three_dimensional_supervision_and_learned_codes_train_too() {
    let corpus = Corpus::new();
    let codes = "encoder={\"kind\":\"codes\"}";
    let more = ["--supervision", "occupancy", "--set", codes, "--categories", "rings", "--devices", "cpu,cpu"];
    let said = succeeds(&corpus.train("run", &more));
    assert!(said.contains("3 objects"), "{said}");
    let run = corpus.path("run");
    refuses(&dvr(&["eval", text(&run), "--resolution", "16"]), &["--split train"]);
    let table = succeeds(&dvr(&["eval", text(&run), "--resolution", "16", "--split", "train"]));
    assert!(table.contains("| rings | 3 |"), "{table}");
}

#[test]
fn the_encoder_sees_the_inputs_that_it_is_given() {
    let corpus = Corpus::new();
    for (inputs, grey) in [("dark", 0), ("bright", 255)] {
        for object in ["balls", "rings"].iter().flat_map(|category| (0..5).map(move |i| format!("{category}/o{i}"))) {
            let folder = corpus.path(inputs).join(object).join("rendering");
            std::fs::create_dir_all(&folder).unwrap();
            let picture = image::RgbImage::from_pixel(16, 16, image::Rgb([grey; 3]));
            dvr_core::files::write_rgb_png(&folder.join("00.png"), &picture).unwrap();
        }
    }
    let train = |run: &str, inputs: &str, more: &[&str]| {
        let inputs = corpus.path(inputs);
        corpus.train(run, &[&["--inputs", text(&inputs), "--steps", "4", "--no-report"][..], more].concat())
    };
    let curve = |inputs: &str| {
        let run = format!("run-{inputs}");
        succeeds(&train(&run, inputs, &[]));
        corpus.curve(&run)
    };
    let (dark, bright) = (curve("dark"), curve("bright"));
    assert!(dark.len() > 1 && dark.len() == bright.len() && dark != bright, "{dark:?}");
    // A resumed run sees them too.
    succeeds(&train("parts", "dark", &["--time", "0s"]));
    succeeds(&dvr(&["train", "--resume", "--out", text(&corpus.path("parts")), "--no-report"]));
    // Terms that only the first step had are empty columns.
    let last = |curve: &[Vec<String>]| -> Vec<String> {
        curve.last().unwrap().iter().filter(|cell| !cell.is_empty()).cloned().collect()
    };
    assert_eq!(last(&corpus.curve("parts")), last(&dark));
    std::fs::remove_dir_all(corpus.path("bright/rings")).unwrap();
    let told = String::from_utf8_lossy(&train("less", "bright", &[]).stderr).into_owned();
    assert!(told.contains("rings"), "{told}");
}

#[test]
fn a_pretrained_resnet_is_where_the_encoder_starts() {
    let corpus = Corpus::new();
    let (name, prefix) = ("encoder.features.layer1.0.conv1.weight", "encoder.features.");
    let encoder = EncoderConfig::Resnet18 { image_size: 32 };
    let config = ImageModelConfig { encoder, decoder: DecoderConfig::new().with_code_dim(8).with_hidden(16) };
    let donor = to_safetensors(&seeded(11, || config.init(&Device::flex())), &config).unwrap();
    let floats = |bytes: &[u8]| -> Vec<f32> { bytes.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect() };
    let file = SafeTensors::deserialize(&donor).unwrap();
    let trained = floats(file.tensor(name).unwrap().data());
    let features = file.iter().filter(|(name, tensor)| name.starts_with(prefix) && tensor.dtype() == Dtype::F32);
    let features =
        features.map(|(name, tensor)| (name[prefix.len()..].into(), tensor.shape().into(), floats(tensor.data())));
    let path = corpus.path("resnet18.pth");
    write_pytorch(&path, &Entry::tensors(features));

    let apart = |run: &str, more: &[&str]| {
        let resnet = ["--set", "encoder={\"kind\":\"resnet18\",\"image_size\":32}", "--set", "learning_rate=0.001"];
        let resnet = [&resnet[..], &["--steps", "1", "--no-report"]].concat();
        succeeds(&corpus.train(run, &[&resnet[..], more].concat()));
        let exported = corpus.path("net.safetensors");
        succeeds(&dvr(&["export", text(&corpus.path(run).join("last.ckpt")), "--out", text(&exported), "--overwrite"]));
        let bytes = std::fs::read(exported).unwrap();
        let file = SafeTensors::deserialize(&bytes).unwrap();
        max_difference(&floats(file.tensor(name).unwrap().data()), &trained)
    };
    let (pretrained, fresh) = (apart("pretrained", &["--pretrained", text(&path)]), apart("fresh", &[]));
    println!("after a step {pretrained:e} from what was given, {fresh:e} without");
    // A step of Adam moves a weight by its rate at most.
    assert!(pretrained < 2e-3 && fresh > 0.01, "{pretrained:e} {fresh:e}");
    refuses(&corpus.train("x", &["--pretrained", text(&corpus.path("gone.pth"))]), &["gone.pth"]);
}

#[test]
fn what_makes_no_sense_is_refused_before_anything_is_written() {
    let corpus = Corpus::new();
    let data = corpus.data();
    refuses(&corpus.train("x", &["--method", "grid"]), &["--method network"]);
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
