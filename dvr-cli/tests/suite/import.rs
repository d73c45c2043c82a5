//! Checkpoints of DVR's reference code as runs, and pictures as meshes.

use std::path::{Path, PathBuf};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::files::{read_rgb, write_rgb_png, write_rgba_png};
use dvr_core::mesh::read_mesh;
use dvr_core::npz::{Array, write_npz};
use dvr_tests::{Entry, fixture, write_pytorch};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use safetensors::SafeTensors;

/// Length of the small model's codes.
const CODE: usize = 2;

/// Width of its hidden layers.
const HIDDEN: usize = 8;

/// A linear layer by its two parts.
type Layer = [(String, Vec<usize>, Vec<f32>); 2];

fn linear(name: &str, output: usize, input: usize, weight: impl Fn(usize, usize) -> f32, bias: f32) -> Layer {
    let weights = (0..output * input).map(|i| weight(i / input, i % input)).collect();
    [
        (format!("{name}.weight"), vec![output, input], weights),
        (format!("{name}.bias"), vec![output], vec![bias; output]),
    ]
}

/// A decoder whose surface is an octahedron, `|x| + |y| + |z| = 0.3 + c`, with `c` the first entry of the code.
fn octahedron(code: usize) -> Vec<Layer> {
    // Hidden units hold the coordinates, their negatives, and c: the last ReLU makes magnitudes of the coordinates.
    let coordinate = |unit: usize, axis: usize| match unit {
        0..=2 if unit == axis => 1.0,
        3..=5 if unit - 3 == axis => -1.0,
        _ => 0.0,
    };
    let mut layers = vec![linear("decoder.fc_p", HIDDEN, 3, coordinate, 0.0)];
    let zero = |_, _| 0.0;
    layers.push(linear("decoder.blocks.0.fc_0", HIDDEN, HIDDEN, zero, 0.0));
    layers.push(linear("decoder.blocks.0.fc_1", HIDDEN, HIDDEN, zero, 0.0));
    let out = |channel: usize, unit: usize| match (channel, unit) {
        (0, 0..=5) => -10.0,
        (0, 6) => 10.0,
        (1, 6) => 1.0,
        _ => 0.0,
    };
    layers.push(linear("decoder.fc_out", 4, HIDDEN, out, 0.0));
    layers[3][1].2[0] = 3.0;
    if code > 0 {
        let take = |unit: usize, entry: usize| if (unit, entry) == (6, 0) { 1.0 } else { 0.0 };
        layers.push(linear("decoder.fc_c.0", HIDDEN, code, take, 0.0));
    }
    layers
}

/// Adds a convolutional encoder whose code is 0.1 for every picture.
fn with_encoder(mut layers: Vec<Layer>) -> Vec<Layer> {
    for (i, (input, output)) in [(3, 1), (1, 2), (2, 4), (4, 8), (8, 16)].into_iter().enumerate() {
        let mut layer = linear(&format!("encoder.conv{i}"), output, input * 9, |_, _| 0.0, 0.0);
        layer[0].1 = vec![output, input, 3, 3];
        layers.push(layer);
    }
    layers.push(linear("encoder.fc_out", CODE, 16, |_, _| 0.0, 0.1));
    layers
}

/// Writes a checkpoint as the reference code does.
fn checkpoint(tiny: &Tiny, name: &str, layers: Vec<Layer>) -> PathBuf {
    let path = tiny.path(name);
    let model = Entry::tensors(layers.into_iter().flatten());
    let entries = [("model", model), ("epoch_it", Entry::Whole(4)), ("it", Entry::Whole(99))];
    write_pytorch(&path, &Entry::Dict(entries.map(|(key, entry)| (key.to_owned(), entry)).into()));
    path
}

fn height(path: &Path) -> f32 {
    let (low, high) = read_mesh(path).unwrap().mesh.bounds().unwrap();
    (high - low).y
}

#[test]
fn a_network_of_one_scene_is_meshed_rendered_and_exported_without_the_scene() {
    let tiny = Tiny::new();
    let file = checkpoint(&tiny, "model.pt", octahedron(0));
    let run = tiny.path("run");
    let said = succeeds(&dvr(&["import", text(&file), "--out", text(&run)]));
    assert!(said.contains("after 100 steps") && said.contains("dvr mesh"), "{said}");
    let mesh = tiny.path("mesh.ply");
    succeeds(&dvr(&["mesh", text(&run), "--out", text(&mesh), "--resolution", "32"]));
    assert!((height(&mesh) - 0.6).abs() < 0.02, "{}", height(&mesh));
    let frames = tiny.path("frames");
    succeeds(&dvr(&["render", text(&run), "--out", text(&frames), "--frames", "1", "--size", "16"]));
    assert!(frames.join("orbit_0000.png").is_file());
    let exported = tiny.path("net.safetensors");
    succeeds(&dvr(&["export", text(&run), "--out", text(&exported)]));
    let bytes = std::fs::read(&exported).unwrap();
    let names = SafeTensors::deserialize(&bytes).unwrap().names().len();
    assert_eq!(names, 8);

    refuses(&dvr(&["import", text(&file), "--out", text(&run)]), &["already holds a run", "--overwrite"]);
    succeeds(&dvr(&["import", text(&file), "--out", text(&run), "--overwrite"]));
    refuses(&dvr(&["eval", text(&run)]), &["--data"]);
    let scene = tiny.scene();
    assert!(
        succeeds(&dvr(&["eval", text(&run), "--data", text(&scene), "--resolution", "32", "--no-views"]))
            .contains("IoU")
    );
    refuses(&dvr(&["mesh", text(&run), "--object", "0"]), &["no learned codes"]);
    refuses(&dvr(&["predict", text(&run), "x.png", "--out", "x"]), &["takes no pictures"]);
}

#[test]
fn an_imported_network_is_trained_further_with_its_scene() {
    let tiny = Tiny::new();
    let file = checkpoint(&tiny, "model.pt", octahedron(0));
    let (run, scene, yaml) = (tiny.path("run"), tiny.scene(), tiny.path("configs/tiny.yaml"));
    std::fs::create_dir(tiny.path("configs")).unwrap();
    std::fs::write(tiny.path("configs/base.yaml"), "model:\n  c_dim: 0\n  encoder: null\n").unwrap();
    let config =
        "inherit_from: configs/base.yaml\ntraining:\n  n_training_points: 64\n  batch_size: 1\n  n_workers: 8\n";
    std::fs::write(&yaml, config).unwrap();
    let arguments = ["import", text(&file), "--out", text(&run), "--data", text(&scene), "--yaml", text(&yaml)];
    let output = dvr(&arguments);
    succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("training.n_workers has no meaning here"), "{said}");
    let config = std::fs::read_to_string(run.join("config.json")).unwrap();
    assert!(config.contains("\"rays\": 64"), "{config}");
    succeeds(&dvr(&["train", "--resume", "--out", text(&run), "--time", "0s", "--resolution", "32"]));
    let table = succeeds(&dvr(&["eval", text(&run), "--resolution", "32", "--no-views"]));
    assert!(table.contains("volume IoU"), "{table}");

    // The same configuration starts a training of its own.
    let fresh = tiny.path("fresh");
    let arguments = ["train", text(&scene), "--out", text(&fresh), "--config", text(&yaml), "--resolution", "32"];
    let small = ["--time", "0s", "--set", "model.hidden=8", "--set", "march=[{\"from_percent\":0,\"samples\":8}]"];
    let output = dvr(&[&arguments[..], &small[..]].concat());
    assert!(fresh.join("last.ckpt").is_file(), "{}", String::from_utf8_lossy(&output.stderr));
    let other = tiny.path("other");
    let both = ["train", text(&scene), "--out", text(&other), "--config", text(&yaml), "--method", "classic"];
    refuses(&dvr(&both), &["--method"]);
    std::fs::write(&yaml, "inherit_from: gone.yaml\n").unwrap();
    refuses(&dvr(&["import", text(&file), "--out", "x", "--yaml", text(&yaml)]), &["gone.yaml"]);
}

#[test]
fn codes_choose_among_the_objects_of_a_decoder() {
    let tiny = Tiny::new();
    let file = checkpoint(&tiny, "model.pt", octahedron(CODE));
    let (run, codes) = (tiny.path("run"), tiny.path("codes.npz"));
    refuses(&dvr(&["import", text(&file), "--out", text(&run)]), &["model.pt", "length 2", "--codes"]);
    assert!(!run.exists(), "nothing half-made");
    write_npz(&codes, &[("codes", &Array::f64(&[2, 2], vec![0.0, 5.0, 0.1, 5.0]))]).unwrap();
    succeeds(&dvr(&["import", text(&file), "--out", text(&run), "--codes", text(&codes)]));
    let mesh = tiny.path("mesh.ply");
    let of = |object: &str| {
        let mesh_of = ["mesh", text(&run), "--object", object, "--out", text(&mesh), "--resolution", "32"];
        succeeds(&dvr(&[&mesh_of[..], &["--overwrite"]].concat()));
        height(&mesh)
    };
    let (first, second) = (of("0"), of("1"));
    assert!((first - 0.6).abs() < 0.02 && (second - 0.8).abs() < 0.02, "{first} {second}");
    refuses(&dvr(&["mesh", text(&run), "--object", "2"]), &["2 objects"]);
    refuses(&dvr(&["mesh", text(&run)]), &["--object"]);
    refuses(&dvr(&["predict", text(&run), "x.png", "--out", "x"]), &["takes no pictures", "--object"]);
    let exported = tiny.path("net.safetensors");
    succeeds(&dvr(&["export", text(&run), "--out", text(&exported)]));
    assert!(SafeTensors::deserialize(&std::fs::read(&exported).unwrap()).unwrap().tensor("encoder.weight").is_ok());
}

#[test]
fn pictures_become_coloured_meshes_and_previews_and_broken_ones_are_left_out() {
    let tiny = Tiny::new();
    let file = checkpoint(&tiny, "model.pt", with_encoder(octahedron(CODE)));
    let run = tiny.path("run");
    let said = succeeds(&dvr(&["import", text(&file), "--out", text(&run)]));
    assert!(said.contains("dvr predict"), "{said}");
    refuses(&dvr(&["mesh", text(&run)]), &["dvr predict"]);

    let pictures = tiny.path("pictures");
    std::fs::create_dir(&pictures).unwrap();
    let dot = |u: u32, v: u32| (4..9).contains(&u) && (2..12).contains(&v);
    let plain = RgbImage::from_fn(32, 16, |u, v| if dot(u, v) { Rgb([200, 30, 30]) } else { Rgb([255; 3]) });
    write_rgb_png(&pictures.join("plain.png"), &plain).unwrap();
    let clear = RgbaImage::from_fn(16, 16, |u, v| Rgba([200, 30, 30, if dot(u, v) { 255 } else { 0 }]));
    write_rgba_png(&pictures.join("clear.png"), &clear).unwrap();
    std::fs::write(pictures.join("broken.png"), "no picture").unwrap();
    let out = tiny.path("out");
    let predict = |more: &[&str]| {
        let (alone, pictures) = (pictures.join("plain.png"), text(&pictures).to_owned());
        let arguments = ["predict", text(&run), &pictures, text(&alone), "--out", text(&out), "--resolution", "32"];
        dvr(&[&arguments[..], more].concat())
    };
    let output = predict(&[]);
    let said = succeeds(&output);
    assert!(said.contains("3 of 4 pictures") && said.contains("1 left out"), "{said}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("broken.png"));
    for name in ["plain", "clear", "plain_2"] {
        let mesh = read_mesh(out.join(format!("{name}.glb"))).unwrap().mesh;
        assert!(mesh.colors.is_some() && (height(&out.join(format!("{name}.ply"))) - 0.8).abs() < 0.02, "{name}");
        assert!(read_rgb(&out.join(format!("{name}.png"))).unwrap().width() > 4 * 192);
    }
    // What is there is kept; an interrupted call goes on.
    std::fs::remove_file(out.join("clear.png")).unwrap();
    assert!(succeeds(&predict(&[])).contains("1 of 4 pictures became meshes"));
    assert!(succeeds(&predict(&[])).contains("0 of 4 pictures became meshes"));
    // Of another picture or other settings, they are made again.
    let clear = RgbaImage::from_fn(16, 16, |u, v| Rgba([30, 30, 200, if dot(u, v) { 255 } else { 0 }]));
    write_rgba_png(&pictures.join("clear.png"), &clear).unwrap();
    assert!(succeeds(&predict(&[])).contains("1 of 4 pictures became meshes"));
    assert!(succeeds(&predict(&["--crop", "--background", "white"])).contains("3 of 4 pictures"));
    let record: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("clear.json")).unwrap()).unwrap();
    assert!(record["key"]["program"].as_str().is_some_and(|program| program.starts_with("dvr ")), "{record}");

    let masks = tiny.path("masks");
    std::fs::create_dir(&masks).unwrap();
    write_rgb_png(&masks.join("plain.png"), &RgbImage::from_pixel(32, 16, Rgb([255; 3]))).unwrap();
    let output = predict(&["--overwrite", "--masks", text(&masks)]);
    assert!(succeeds(&output).contains("2 of 4 pictures"));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no mask of the name"));
}

#[test]
fn predictions_without_a_usable_picture_fail() {
    let tiny = Tiny::new();
    let file = checkpoint(&tiny, "model.pt", with_encoder(octahedron(CODE)));
    let run = tiny.path("run");
    succeeds(&dvr(&["import", text(&file), "--out", text(&run)]));
    let out = tiny.path("out");
    let predict = |picture: &Path, more: &[&str]| {
        let arguments = ["predict", text(&run), text(picture), "--out", text(&out), "--resolution", "16"];
        dvr(&[&arguments[..], more].concat())
    };
    refuses(&predict(&tiny.path("nowhere.png"), &[]), &["nowhere.png", "no picture could be used"]);
    std::fs::create_dir(tiny.path("empty")).unwrap();
    refuses(&predict(&tiny.path("empty"), &[]), &["empty", "no pictures"]);
    let white = tiny.path("white.png");
    write_rgb_png(&white, &RgbImage::from_pixel(8, 8, Rgb([255; 3]))).unwrap();
    refuses(&predict(&white, &["--crop"]), &["--crop", "--background"]);
    refuses(&predict(&white, &["--crop", "--background", "white"]), &["nothing in it"]);
    refuses(&predict(&white, &["--masks", text(&tiny.path("gone"))]), &["gone"]);
}

#[test]
fn a_file_that_is_not_a_reference_checkpoint_is_named() {
    let tiny = Tiny::new();
    let (file, out) = (tiny.path("x.pt"), tiny.path("run"));
    let import = || dvr(&["import", text(&file), "--out", text(&out)]);
    refuses(&import(), &["x.pt"]);
    std::fs::write(&file, "no checkpoint").unwrap();
    refuses(&import(), &["x.pt", "not a readable file of tensors"]);
    write_pytorch(&file, &Entry::tensors([("layer.weight".to_owned(), vec![1], vec![0.0])]));
    refuses(&import(), &["x.pt", "layer.weight"]);
    assert!(!out.exists(), "nothing half-made");
    // A tensor of a layer too many.
    let mut layers = octahedron(0);
    layers.push(linear("decoder.blocks.5.fc_0", HIDDEN, HIDDEN, |_, _| 0.0, 0.0));
    checkpoint(&tiny, "x.pt", layers);
    refuses(&import(), &["x.pt", "blocks.5.fc_0"]);
}

#[test]
fn a_checkpoint_of_the_reference_code_is_exported_as_it_was() {
    let reference = fixture("decoder_c0_h64.safetensors");
    let tiny = Tiny::new();
    for name in ["decoder_c0_h64.pt", "decoder_c0_h64_legacy.pt"] {
        let (run, exported) = (tiny.path(name), tiny.path("net.safetensors"));
        let output = dvr(&["import", text(&fixture(name)), "--out", text(&run)]);
        assert!(succeeds(&output).contains("with the state of Adam"));
        succeeds(&dvr(&["export", text(&run), "--out", text(&exported), "--overwrite"]));
        let bytes = [&exported, &reference].map(|path| std::fs::read(path).unwrap());
        let [ours, theirs] = bytes.each_ref().map(|bytes| SafeTensors::deserialize(bytes).unwrap());
        assert_eq!(ours.len(), theirs.len());
        assert!(theirs.iter().all(|(name, tensor)| ours.tensor(name).unwrap() == tensor), "bit for bit");
    }
}
