//! From a folder to a scene.

use std::path::Path;

use super::layouts::{detect_format, find_views};
use super::load::{check_masks, load_views, select_views};
use super::object_space::{asked_views, check_cube, into_object_space, keep_points_on_object};
use super::options::ReadOptions;
use super::pairing::folder_name;
use crate::error::Result;
use crate::scene::Scene;

/// Reads the scene at `path`, a folder or the file with its cameras, in whatever layout it is.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) where a file is missing, [`Error::Format`](crate::Error::Format) where one is damaged or does not fit the others,
/// [`Error::Scratch`](crate::Error::Scratch) where the temporary folder has no room for what [`ReadOptions::max_memory`] puts there. Where all
/// files are sound but make no usable scene: [`Error::TooFewViews`](crate::Error::TooFewViews), [`Error::MasksEmpty`](crate::Error::MasksEmpty), [`Error::NoPlace`](crate::Error::NoPlace) or
/// [`Error::Normalisation`](crate::Error::Normalisation). A picture without a mask is no error: see [`Scene::require_masks`].
pub fn read_scene(path: &Path, options: &ReadOptions) -> Result<Scene> {
    let format = options.format.map_or_else(|| detect_format(path), Ok)?;
    let mut raw = find_views(format, path, options)?;
    select_views(&mut raw, options)?;
    let mut views = load_views(&mut raw, options)?;
    check_masks(&mut raw, &views)?;
    options.cancellation.check()?;
    let asked = asked_views(&views, options);
    let (object_to_world, region) = into_object_space(&mut raw, &mut views, &asked, options.normalise)?;
    check_cube(&views, &mut raw.warnings);
    keep_points_on_object(&mut raw, &views, &asked);
    Ok(Scene {
        name: folder_name(&raw.root),
        source: path.to_owned(),
        format: raw.format,
        views,
        object_to_world,
        region,
        sparse_points: raw.sparse_points,
        ground_truth: raw.ground_truth,
        warnings: raw.warnings,
    })
}

impl Scene {
    /// Reads the scene at `path` with [`ReadOptions::default`]: [`read_scene`] for those who have nothing to choose.
    ///
    /// # Errors
    /// As [`read_scene`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        read_scene(path.as_ref(), &ReadOptions::default())
    }
}
