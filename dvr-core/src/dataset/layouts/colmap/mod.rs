//! COLMAP sparse models, text and binary: <https://colmap.github.io/format.html>.
//!
//! Cameras are ours already: x right, y down, z forward, pixel centres at half integers. Only pinholes are read.

mod binary;
mod model;
mod points;
mod text;

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use super::layout::Layout;
use crate::camera::Similarity;
use crate::dataset::masks::find_masks;
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{natural_order, sub_folder, view_names};
use crate::dataset::raw_scene::{ObjectBounds, Projection, RawScene, RawView};
use crate::error::{Error, Result};
use crate::scene::{GroundTruth, Split};
use model::{ModelCamera, ModelImage};
pub(in crate::dataset) use points::read_verified_points;

/// COLMAP: a sparse model, text or binary, of undistorted images.
pub(super) const LAYOUT: Layout = Layout {
    name: "colmap",
    aliases: &[],
    known_by: "sparse/0/images.bin or .txt (COLMAP)",
    is_at: |path| Ok(path.is_dir() && model_folder(path).is_some()),
    find,
};

/// The folder of the model at or below `path`.
fn model_folder(path: &Path) -> Option<PathBuf> {
    let holds_model =
        |folder: &PathBuf| ["bin", "txt"].iter().any(|kind| folder.join(format!("images.{kind}")).is_file());
    ["sparse/0", "sparse", "colmap/sparse/0", "."].iter().map(|below| path.join(below)).find(holds_model)
}

/// Finds the views of the model at or below `path`.
fn find(path: &Path, _: &ReadOptions) -> Result<RawScene> {
    let folder = model_folder(path).ok_or_else(|| {
        Error::format(
            path,
            "there is no sparse model (looked for images.bin and images.txt in sparse/0, sparse and here)",
            "Give the folder with `images` and `sparse`.",
        )
    })?;
    let mut warnings = Vec::new();
    if folder.ends_with("sparse/0") && folder.with_file_name("1").is_dir() {
        warnings.push("COLMAP made several models that are not connected; sparse/0 is used".to_owned());
    }
    let binary = folder.join("images.bin").is_file();
    let mut model = if binary { binary::read_model(&folder)? } else { text::read_model(&folder)? };
    let images_file = folder.join(if binary { "images.bin" } else { "images.txt" });
    model.images.sort_by(|a, b| natural_order(&a.name, &b.name));

    let root = root_of(path, &folder);
    let image_folder = sub_folder(&root, &["images", "image", "input", "rgb"]).unwrap_or_else(|| root.clone());
    let relative: Vec<PathBuf> = model.images.iter().map(|image| PathBuf::from(&image.name)).collect();
    let names = view_names(&relative, &images_file)?;
    let masks = find_masks(&root, &relative)?;
    let mut views = Vec::with_capacity(relative.len());
    for (((image, relative), name), mask) in model.images.iter().zip(&relative).zip(names).zip(masks) {
        let camera = model.cameras.get(&image.camera).ok_or_else(|| {
            Error::format(
                &images_file,
                format!("image `{}` has camera {}, which does not exist", image.name, image.camera),
                "Export the model again.",
            )
        })?;
        let projection = projection(camera, image, &folder)?;
        let image = image_folder.join(relative);
        views.push(RawView { name, image, mask, depth: None, projection, split: Split::Train });
    }
    Ok(RawScene {
        format: "COLMAP",
        cameras: images_file,
        views,
        files_to_world: Similarity::default(),
        object_bounds: ObjectBounds::Unknown,
        sparse_points: points::sparse_points(&model, &folder),
        ground_truth: GroundTruth::default(),
        warnings,
        root,
    })
}

/// The folder with images and masks: the one that was given, unless that is the model's own.
fn root_of(path: &Path, model: &Path) -> PathBuf {
    let same = |a: &Path, b: &Path| a.canonicalize().ok().is_some_and(|a| b.canonicalize().ok() == Some(a));
    let holds_images = |folder: &&Path| sub_folder(folder, &["images", "image", "input", "rgb"]).is_some();
    if !same(path, model) {
        return path.to_owned();
    }
    model.ancestors().take(3).find(holds_images).unwrap_or(path).to_owned()
}

/// The matrix `K` of an image's camera, and the size of its picture.
fn lens(camera: &ModelCamera, image: &ModelImage, folder: &Path) -> Result<(DMat3, (u32, u32))> {
    let (focal_x, focal_y, cx, cy) = match (camera.model.as_str(), &camera.parameters[..]) {
        ("SIMPLE_PINHOLE", &[focal, cx, cy]) => (focal, focal, cx, cy),
        ("PINHOLE", &[focal_x, focal_y, cx, cy]) => (focal_x, focal_y, cx, cy),
        ("SIMPLE_PINHOLE" | "PINHOLE", parameters) => {
            return Err(Error::format(
                folder,
                format!("camera {} ({}) has {} parameters", image.camera, camera.model, parameters.len()),
                "Export the model again.",
            ));
        }
        (model, _) => {
            return Err(Error::format(
                folder,
                format!("camera {} is of model {model}, with lens distortion", image.camera),
                "Run `colmap image_undistorter` and give its output folder.",
            ));
        }
    };
    let size = match (u32::try_from(camera.width), u32::try_from(camera.height)) {
        (Ok(width @ 1..), Ok(height @ 1..)) => (width, height),
        _ => {
            return Err(Error::format(
                folder,
                format!("camera {} has {}x{} pixels", image.camera, camera.width, camera.height),
                "Export the model again.",
            ));
        }
    };
    let k = DMat3::from_cols(DVec3::new(focal_x, 0.0, 0.0), DVec3::new(0.0, focal_y, 0.0), DVec3::new(cx, cy, 1.0));
    Ok((k, size))
}

/// The rotation of an image, world to camera.
fn rotation(image: &ModelImage, folder: &Path) -> Result<DMat3> {
    let [w, x, y, z] = image.rotation;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    if !(rotation.length() > 0.5 && rotation.length() < 2.0) {
        return Err(Error::format(
            folder,
            format!("the rotation of image `{}` is not a unit quaternion ({w} {x} {y} {z})", image.name),
            "Export the model again.",
        ));
    }
    Ok(DMat3::from_quat(rotation.normalize()))
}

fn projection(camera: &ModelCamera, image: &ModelImage, folder: &Path) -> Result<Projection> {
    let (k, size) = lens(camera, image, folder)?;
    Ok(Projection::from_parts(k, rotation(image, folder)?, image.translation.into(), Some(size)))
}
