//! COLMAP sparse models, text and binary: <https://colmap.github.io/format.html>.
//!
//! Cameras are ours already: x right, y down, z forward, pixel centres at half integers. Where a lens
//! distorts, pictures are undistorted as they are read.

mod binary;
mod model;
mod points;
mod posed;
mod text;

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat};

use super::layout::Layout;
use crate::camera::Similarity;
use crate::dataset::masks::find_masks;
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{natural_order, sub_folder, view_names};
use crate::dataset::raw_scene::{ObjectBounds, Projection, RawScene, RawView};
use crate::error::{Error, Result};
use crate::lens::Lens;
use crate::scene::{GroundTruth, Split};
use model::{ModelCamera, ModelImage};
pub(in crate::dataset) use points::read_verified_points;
pub use posed::{ColmapModel, PosedPicture, read_colmap_model};

/// COLMAP: a sparse model, text or binary.
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
        let lens = lens(camera, image, &folder)?;
        let projection = projection(&lens, image, &folder)?;
        let (image, lens) = (image_folder.join(relative), Some(lens).filter(|lens| !lens.is_pinhole()));
        views.push(RawView { name, image, mask, depth: None, projection, lens, split: Split::Train });
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

/// The lens of an image's camera.
fn lens(camera: &ModelCamera, image: &ModelImage, folder: &Path) -> Result<Lens> {
    let (Ok(width @ 1..), Ok(height @ 1..)) = (u32::try_from(camera.width), u32::try_from(camera.height)) else {
        return Err(Error::format(
            folder,
            format!("camera {} has {}x{} pixels", image.camera, camera.width, camera.height),
            "Export the model again.",
        ));
    };
    Lens::from_colmap(&camera.model, width, height, &camera.parameters).map_err(|problem| {
        Error::format(folder, format!("camera {}: {problem}", image.camera), "Export the model again.")
    })
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

/// The projection without the distortion of the lens.
fn projection(lens: &Lens, image: &ModelImage, folder: &Path) -> Result<Projection> {
    let rotation = rotation(image, folder)?;
    Ok(Projection::from_parts(lens.intrinsics(), rotation, image.translation.into(), Some(lens.size)))
}
