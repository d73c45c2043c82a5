//! Scenes from disk: five layouts of posed photographs, one [`Scene`].
//!
//! ```no_run
//! use dvr_core::dataset::{ReadOptions, read_scene};
//!
//! let scene = read_scene("photos/teapot".as_ref(), &ReadOptions::default())?;
//! println!("{}: {} views, {}", scene.name, scene.views.len(), scene.format);
//! for warning in &scene.warnings {
//!     println!("note: {warning}");
//! }
//! # Ok::<(), dvr_core::Error>(())
//! ```
//!
//! A reader turns its files into a list of views with projection matrices, and what is peculiar to its layout (axes,
//! pixel centres, units) ends there. Reading pixels, finding the object and moving it into the unit cube is the same
//! for all.

mod colmap;
mod crop;
mod downscale;
mod dvr;
mod found;
mod idr;
mod input_picture;
mod load;
mod masks;
mod matrices;
mod middlebury;
mod object_dataset;
mod objects;
mod options;
mod pairing;
mod place;
mod transforms;
mod write_transforms;

use std::path::Path;

pub use crop::square_around;
pub use input_picture::input_picture;
pub use masks::mask_from_background;
pub use object_dataset::{ObjectDataset, ObjectOptions};
pub use objects::{ObjectRef, is_object_dataset, list_objects};
pub use options::{Background, BackgroundColor, Format, Normalise, ReadOptions};
pub use pairing::list_pictures;
pub use write_transforms::write_transforms;

use crate::error::{Error, Result};
use crate::npz::NpzFile;
use crate::scene::Scene;

/// Reads the scene at `path`, a folder or the file with its cameras, in whatever layout it is.
///
/// # Errors
/// [`Error::Io`] where a file is missing, [`Error::Format`] where one is damaged or does not fit the others,
/// [`Error::Scratch`] where the temporary folder has no room for what [`ReadOptions::max_memory`] puts there. Where all
/// files are sound but make no usable scene: [`Error::TooFewViews`], [`Error::MasksEmpty`], [`Error::NoPlace`] or
/// [`Error::Normalisation`]. A picture without a mask is no error: see [`Scene::require_masks`].
pub fn read_scene(path: &Path, options: &ReadOptions) -> Result<Scene> {
    let format = options.format.map_or_else(|| detect_format(path), Ok)?;
    let mut found = match format {
        Format::Dvr => dvr::find(path, options)?,
        Format::Transforms => transforms::find(path)?,
        Format::Idr => idr::find(path)?,
        Format::Middlebury => middlebury::find(path)?,
        Format::Colmap => colmap::find(path)?,
    };
    load::select_views(&mut found, options)?;
    let mut views = load::load_views(&mut found, options)?;
    load::check_masks(&mut found, &views)?;
    let object_to_world = place::into_object_space(&mut found, &mut views, options.normalise)?;
    place::check_cube(&views, &mut found.warnings);
    place::keep_points_on_object(&mut found, &views);
    Ok(Scene {
        name: pairing::folder_name(&found.root),
        source: path.to_owned(),
        format: found.format,
        views,
        object_to_world,
        sparse_points: found.sparse_points,
        ground_truth: found.ground_truth,
        warnings: found.warnings,
    })
}

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
    if path.is_dir() && (dvr::cameras_file(path).is_some() || !list_objects(path, None)?.is_empty()) {
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

#[cfg(test)]
mod tests;
