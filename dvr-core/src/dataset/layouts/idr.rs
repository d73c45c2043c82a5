//! The layout of IDR and NeuS: `image/`, `mask/` and `cameras_sphere.npz` (NeuS) or `cameras.npz` (IDR).
//!
//! `world_mat_i` = K\[R|t\] takes the world to pixels whose *centres* are at integers; `scale_mat_i` takes the unit
//! sphere around the object to the world.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::layout::Layout;
use crate::camera::Similarity;
use crate::dataset::masks::find_masks;
use crate::dataset::matrices::{cameras_npz, numbers_of, read_matrix};
use crate::dataset::object_files::image_folder;
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{camera_indices, folder_of, list_files, pictures, view_names};
use crate::dataset::raw_scene::{Coordinates, ObjectBounds, Projection, RawScene, RawView};
use crate::error::{Error, Result};
use crate::npz::NpzFile;
use crate::scene::Split;

/// IDR and NeuS: `cameras_sphere.npz` or `cameras.npz` with `world_mat_i` = K\[R|t\] in pixels, and `scale_mat_i`.
pub(super) const LAYOUT: Layout = Layout {
    name: "idr",
    aliases: &["neus"],
    known_by: "cameras_sphere.npz (IDR, NeuS)",
    is_at: |path| {
        let Some(cameras) = cameras_npz(path) else { return Ok(false) };
        Ok(cameras.ends_with("cameras_sphere.npz") || numbers_of(&NpzFile::open(&cameras)?, "camera_mat").is_empty())
    },
    find,
};

/// Finds the views of the folder, or of the folder of the file.
fn find(path: &Path, _: &ReadOptions) -> Result<RawScene> {
    let cameras = cameras_npz(path).ok_or_else(|| {
        Error::format(path, "there is no cameras_sphere.npz and no cameras.npz", "Give the folder that holds it.")
    })?;
    let root = folder_of(&cameras);
    let image_folder = image_folder(&root)?;
    let images = list_files(&image_folder, pictures())?;
    let relative: Vec<PathBuf> = images.iter().filter_map(|path| path.file_name()).map(PathBuf::from).collect();
    let names = view_names(&relative, &image_folder)?;
    let mut npz = NpzFile::open(&cameras)?;
    let indices = camera_indices(&relative, &numbers_of(&npz, "world_mat"), &cameras)?;
    let masks = find_masks(&root, &relative)?;
    let mut views = Vec::with_capacity(images.len());
    for (((name, image), mask), &index) in names.into_iter().zip(images).zip(masks).zip(&indices) {
        let world_mat = read_matrix(&mut npz, &format!("world_mat_{index}"))?;
        let projection = Projection::from_matrix(&world_mat, Coordinates::Pixels(None)).shifted_to_corners();
        views.push(RawView { name, image, mask, depth: None, projection, lens: None, split: Split::Train });
    }
    let scale_mat = indices.first().map(|index| format!("scale_mat_{index}")).filter(|name| npz.contains(name));
    let object_bounds = match scale_mat {
        Some(name) => ObjectBounds::Bound(sphere_to_cube(&mut npz, &name)?),
        None => ObjectBounds::Unknown,
    };
    Ok(RawScene { object_bounds, ..RawScene::new("IDR/NeuS", root, cameras, views) })
}

/// The similarity of the cube around the sphere: it is two radii wide, ours is one unit.
fn sphere_to_cube(npz: &mut NpzFile, name: &str) -> Result<Similarity> {
    let matrix = read_matrix(npz, name)? * glam::DMat4::from_scale(DVec3::splat(2.0));
    let unusable = |source| Error::UnusableCamera { path: npz.path().to_owned(), what: format!("`{name}`: "), source };
    Similarity::from_matrix(&matrix).map_err(unusable)
}
