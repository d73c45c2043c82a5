//! Which layout a folder has.

use std::path::Path;

use super::object_files::cameras_file;
use super::objects::{list_objects, object_folders};
use super::options::Format;
use super::{colmap, idr, matrices, middlebury, transforms};
use crate::error::{Error, Result};
use crate::npz::NpzFile;

/// Finds out the layout by the files that are there.
///
/// # Errors
/// [`Error::Io`] where there is nothing at `path`; [`Error::Format`] listing what was looked for where nothing fits.
pub fn detect_format(path: &Path) -> Result<Format> {
    std::fs::metadata(path).map_err(|source| Error::io(path, source))?;
    if !transforms::files(path).is_empty() {
        return Ok(Format::Transforms);
    }
    if middlebury::cameras_file(path).is_some() {
        return Ok(Format::Middlebury);
    }
    if path.is_dir() && colmap::model_folder(path).is_some() {
        return Ok(Format::Colmap);
    }
    if let Some(cameras) = idr::cameras_file(path) {
        let is_dvr = !matrices::numbers_of(&NpzFile::open(&cameras)?, "camera_mat").is_empty();
        return Ok(if is_dvr && !cameras.ends_with("cameras_sphere.npz") { Format::Dvr } else { Format::Idr });
    }
    if path.is_dir() && (cameras_file(path).is_some() || !list_objects(path, None)?.is_empty()) {
        return Ok(Format::Dvr);
    }
    Err(Error::format(
        path,
        "no scene was found; looked for cameras.npz, or *.lst and folders with cameras.npz (DVR), transforms.json or \
         transforms_train.json (NeRF, nerfstudio), cameras_sphere.npz (IDR, NeuS), *_par.txt (Middlebury), and \
         sparse/0/images.bin or .txt (COLMAP)",
        "Give the folder that holds one of these.",
    ))
}

/// Whether `path` holds several objects in the DVR layout, rather than a scene.
///
/// # Errors
/// [`Error::Io`] where a folder or list cannot be read, [`Error::Format`] where a list names an object without a
/// folder.
pub fn is_object_dataset(path: &Path) -> Result<bool> {
    let is_scene = || cameras_file(path).is_some() || !matches!(detect_format(path), Ok(Format::Dvr));
    Ok(path.is_dir() && !is_scene() && object_folders(path)?.len() > 1)
}
