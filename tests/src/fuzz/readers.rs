//! The list of readers. One entry per door and kind of file; a new reader is a new entry.

use std::path::{Path, PathBuf};

use burn::tensor::Device;
use dvr_core::Similarity;
use dvr_core::dataset::{Normalise, ReadOptions, list_objects, read_scene};
use dvr_core::files::{read_depth_exr, read_mask, read_photo, upright_photo};
use dvr_core::mat::read_mat;
use dvr_core::mesh::read_mesh;
use dvr_core::npz::{Array, NpzFile};
use dvr_core::synth::SynthConfig;
use dvr_grid::grid_file;
use dvr_model::{DecoderConfig, ImageModelConfig, load_safetensors, read_pytorch};
use dvr_render::ViewColor;
use dvr_report::Curves;
use dvr_train::{Checkpoint, ReferenceConfig, Supervision, load_model, load_object, method_by_name, read_results};

use super::seeds::{arrays, networks, pictures, runs, scenes, shapes};
use super::{Anatomy, Reader, parts};

/// Every reader.
#[rustfmt::skip]
pub static READERS: &[Reader] = &[
    Reader { name: "png", anatomy: Anatomy::Png, seeds: pictures::png, prepare: nothing, read: picture },
    Reader { name: "jpeg", anatomy: Anatomy::Bytes, seeds: pictures::jpeg, prepare: nothing, read: picture },
    Reader { name: "other_pictures", anatomy: Anatomy::Bytes, seeds: pictures::others, prepare: nothing, read: picture },
    Reader { name: "exr", anatomy: Anatomy::Bytes, seeds: pictures::exr, prepare: nothing, read: exr },
    Reader { name: "npz", anatomy: Anatomy::Zip, seeds: arrays::npz, prepare: nothing, read: npz },
    Reader { name: "npy", anatomy: Anatomy::Text, seeds: arrays::npy, prepare: nothing, read: npy },
    Reader { name: "mat", anatomy: Anatomy::Bytes, seeds: arrays::mat, prepare: nothing, read: mat },
    Reader { name: "ply", anatomy: Anatomy::Text, seeds: shapes::ply, prepare: nothing, read: |folder, bytes| mesh(folder, "a.ply", bytes) },
    Reader { name: "obj", anatomy: Anatomy::Parts, seeds: shapes::obj, prepare: nothing, read: obj },
    Reader { name: "off", anatomy: Anatomy::Text, seeds: shapes::off, prepare: nothing, read: |folder, bytes| mesh(folder, "a.off", bytes) },
    Reader { name: "glb", anatomy: Anatomy::Glb, seeds: shapes::glb, prepare: nothing, read: |folder, bytes| mesh(folder, "a.glb", bytes) },
    Reader { name: "gltf", anatomy: Anatomy::Parts, seeds: shapes::gltf, prepare: nothing, read: gltf },
    Reader { name: "pt", anatomy: Anatomy::Zip, seeds: networks::pt, prepare: nothing, read: pt },
    Reader { name: "pt_legacy", anatomy: Anatomy::Bytes, seeds: networks::pt_legacy, prepare: nothing, read: pt },
    Reader { name: "safetensors", anatomy: Anatomy::Safetensors, seeds: networks::safetensors, prepare: nothing, read: safetensors },
    Reader { name: "scene_dvr", anatomy: Anatomy::Checked(20), seeds: networks::scene_dvr, prepare: nothing, read: |_, bytes| grid_file::from_bytes(bytes).is_ok() },
    Reader { name: "view_color", anatomy: Anatomy::Safetensors, seeds: networks::view_color, prepare: nothing, read: |_, bytes| ViewColor::from_bytes(bytes).is_ok_and(|color| !color.at(glam::Vec3::splat(0.1), glam::Vec3::Z, glam::Vec3::ZERO).is_nan()) },
    Reader { name: "checkpoint", anatomy: Anatomy::Safetensors, seeds: networks::checkpoints, prepare: nothing, read: checkpoint },
    Reader { name: "config_json", anatomy: Anatomy::Text, seeds: runs::config_json, prepare: nothing, read: config_json },
    Reader { name: "reference_yaml", anatomy: Anatomy::Text, seeds: runs::reference_yaml, prepare: nothing, read: reference_yaml },
    Reader { name: "results_jsonl", anatomy: Anatomy::Text, seeds: runs::results_jsonl, prepare: nothing, read: |folder, bytes| read_results(&put(folder, "a.jsonl", bytes)).is_ok() },
    Reader { name: "metrics_csv", anatomy: Anatomy::Text, seeds: runs::metrics_csv, prepare: nothing, read: |folder, bytes| Curves::read(&put(folder, "a.csv", bytes)).is_ok() },
    Reader { name: "transforms_json", anatomy: Anatomy::Text, seeds: scenes::transforms, prepare: scenes::put_pictures, read: |folder, bytes| scene(folder, "transforms.json", bytes) },
    Reader { name: "colmap_text", anatomy: Anatomy::Parts, seeds: scenes::colmap_text, prepare: scenes::put_pictures, read: colmap_text },
    Reader { name: "colmap_binary", anatomy: Anatomy::Parts, seeds: scenes::colmap_binary, prepare: scenes::put_pictures, read: colmap_binary },
    Reader { name: "middlebury", anatomy: Anatomy::Text, seeds: scenes::middlebury, prepare: scenes::put_pictures, read: |folder, bytes| scene(folder, "a_par.txt", bytes) },
    Reader { name: "llff", anatomy: Anatomy::Bytes, seeds: scenes::llff, prepare: scenes::put_pictures, read: |folder, bytes| scene(folder, "poses_bounds.npy", bytes) },
    Reader { name: "cameras_npz", anatomy: Anatomy::Zip, seeds: scenes::cameras_npz, prepare: scenes::put_pictures, read: |folder, bytes| scene(folder, "cameras.npz", bytes) },
    Reader { name: "object_npz", anatomy: Anatomy::Parts, seeds: scenes::object_npz, prepare: scenes::put_object, read: object_npz },
    Reader { name: "object_lists", anatomy: Anatomy::Parts, seeds: scenes::object_lists, prepare: scenes::put_objects, read: object_lists },
];

fn nothing(_: &Path) {}

/// Writes an input to a file.
fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    path
}

fn picture(folder: &Path, bytes: &[u8]) -> bool {
    let path = put(folder, "picture", bytes);
    let (photo, mask) = (read_photo(&path).is_ok(), read_mask(&path).is_ok());
    photo && mask && upright_photo(&path, bytes).is_ok()
}

fn exr(folder: &Path, bytes: &[u8]) -> bool {
    read_depth_exr(&put(folder, "a.exr", bytes)).is_ok()
}

/// Every array of an archive, in every type that callers ask for.
fn npz(folder: &Path, bytes: &[u8]) -> bool {
    let Ok(mut npz) = NpzFile::open(&put(folder, "a.npz", bytes)) else { return false };
    let names: Vec<String> = npz.names().iter().take(8).cloned().collect();
    names.iter().all(|name| {
        npz.read(name).is_ok_and(|array| {
            let lengths: [fn(&Array) -> usize; 4] =
                [|a| a.to_f32().len(), |a| a.to_f64().len(), |a| a.to_i64().len(), |a| a.to_bool().len()];
            lengths.iter().all(|length| length(&array) == array.len())
        })
    })
}

/// A single array, as an archive's only entry.
fn npy(folder: &Path, bytes: &[u8]) -> bool {
    npz(folder, &arrays::archive_of(bytes))
}

/// Arrays as the evaluation data of DTU have them.
fn mat(folder: &Path, bytes: &[u8]) -> bool {
    let arrays = read_mat(&put(folder, "a.mat", bytes), &["ObsMask", "BB"]);
    arrays.is_ok_and(|arrays| arrays.into_iter().all(|array| array.to_f64().len() == array.into_truths().len()))
}

fn mesh(folder: &Path, name: &str, bytes: &[u8]) -> bool {
    read_mesh(put(folder, name, bytes)).is_ok()
}

fn obj(folder: &Path, input: &[u8]) -> bool {
    parts::unpack(folder, input, &["a.obj", "a.mtl", "t.png"]);
    read_mesh(folder.join("a.obj")).is_ok()
}

fn gltf(folder: &Path, input: &[u8]) -> bool {
    parts::unpack(folder, input, &["a.gltf", "a.bin", "t.png"]);
    read_mesh(folder.join("a.gltf")).is_ok()
}

fn pt(folder: &Path, bytes: &[u8]) -> bool {
    read_pytorch(&put(folder, "a.pt", bytes), false, &Device::flex()).is_ok()
}

/// A network of one kind or the other.
fn safetensors(folder: &Path, bytes: &[u8]) -> bool {
    let (path, device) = (put(folder, "a.safetensors", bytes), Device::flex());
    let decoder = load_safetensors::<DecoderConfig>(&path, &device).is_ok();
    load_safetensors::<ImageModelConfig>(&path, &device).is_ok() || decoder
}

/// A checkpoint and the model in it.
fn checkpoint(folder: &Path, bytes: &[u8]) -> bool {
    let Ok(checkpoint) = Checkpoint::load(&put(folder, "a.ckpt", bytes)) else { return false };
    let device = Device::flex();
    load_model(&checkpoint, &device).is_ok() || load_object(&checkpoint, 0, &device).is_ok()
}

/// A configuration of each method, and one of the renderer.
fn config_json(_: &Path, bytes: &[u8]) -> bool {
    let Ok(value) = serde_json::from_slice::<serde_json::Value>(bytes) else { return false };
    let synth = serde_json::from_value::<SynthConfig>(value.clone()).is_ok_and(|config| config.check().is_ok());
    let methods = ["grid", "network", "objects"].map(|name| {
        let method = method_by_name(name, Supervision::Rgb).and_then(|method| method.with_overrides(&value));
        method.is_ok_and(|method| method.check().is_ok())
    });
    synth || methods.contains(&true)
}

fn reference_yaml(folder: &Path, bytes: &[u8]) -> bool {
    let config = ReferenceConfig::read(&put(folder, "a.yaml", bytes));
    config.is_ok_and(|config| config.method().check().is_ok())
}

/// A scene with its cameras in a file of that name.
fn scene(folder: &Path, name: &str, bytes: &[u8]) -> bool {
    put(folder, name, bytes);
    scene_is_read(folder, bytes)
}

/// Reads a scene as its files place it. Finding the object by its masks takes a thousand times as long: one input in 64
/// is read so.
fn scene_is_read(folder: &Path, input: &[u8]) -> bool {
    let by_masks = input.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)).is_multiple_of(64);
    let normalise = if by_masks { Normalise::default() } else { Normalise::Given(Similarity::default()) };
    read_scene(folder, &ReadOptions { normalise, ..ReadOptions::default() }).is_ok()
}

fn colmap_text(folder: &Path, input: &[u8]) -> bool {
    parts::unpack(folder, input, &["cameras.txt", "images.txt", "points3D.txt"]);
    scene_is_read(folder, input)
}

fn colmap_binary(folder: &Path, input: &[u8]) -> bool {
    parts::unpack(folder, input, &["cameras.bin", "images.bin", "points3D.bin"]);
    scene_is_read(folder, input)
}

/// What lies beside the pictures of an object.
fn object_npz(folder: &Path, input: &[u8]) -> bool {
    parts::unpack(folder, input, &["pcl.npz", "points.npz", "pointcloud.npz"]);
    scene_is_read(folder, input)
}

fn object_lists(folder: &Path, input: &[u8]) -> bool {
    parts::unpack(&folder.join("chairs"), input, &["train.lst", "val.lst", "test.lst"]);
    parts::unpack(folder, input, &["metadata.yaml"]);
    list_objects(folder, None).is_ok()
}
