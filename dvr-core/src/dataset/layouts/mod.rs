//! The layouts of posed photographs, one file each, and the one list of them.
//!
//! To add one: write its file, with a [`Layout`] that tells how it is known and how its views are found, and enter it
//! here.

mod colmap;
pub(crate) mod dvr;
mod idr;
mod layout;
mod llff;
mod middlebury;
mod transforms;

use std::path::Path;
use std::str::FromStr;

use super::object_files::cameras_file;
use super::objects::object_folders;
use super::options::{Format, ReadOptions};
use super::raw_scene::RawScene;
use crate::error::{Error, Result};
use layout::Layout;

pub(super) use colmap::read_verified_points as read_colmap_points;
pub use colmap::{ColmapModel, PosedPicture, read_colmap_model};

/// Every layout, in the order in which they are looked for.
const LAYOUTS: &[&Layout] =
    &[&transforms::LAYOUT, &middlebury::LAYOUT, &colmap::LAYOUT, &llff::LAYOUT, &idr::LAYOUT, &dvr::LAYOUT];

impl Format {
    /// The DVR datasets: `image/`, `mask/`, `depth/` and `cameras.npz` with `camera_mat_i`, `world_mat_i`,
    /// `scale_mat_i`. Datasets of many objects are in this layout.
    pub const DVR: Self = Self(dvr::LAYOUT.name);

    /// Every format, in the order in which they are looked for.
    pub fn all() -> impl Iterator<Item = Self> {
        LAYOUTS.iter().map(|layout| Self(layout.name))
    }
}

impl FromStr for Format {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let lower = name.to_lowercase();
        let is_meant = |layout: &&&Layout| layout.name == lower || layout.aliases.contains(&lower.as_str());
        LAYOUTS.iter().find(is_meant).map(|layout| Self(layout.name)).ok_or_else(|| Error::UnknownName {
            what: "format of scenes",
            name: name.to_owned(),
            expected: Format::all().map(|format| format.to_string()).collect::<Vec<_>>().join(", "),
        })
    }
}

/// Finds out the layout by the files that are there.
///
/// # Errors
/// [`Error::Io`] where there is nothing at `path`; [`Error::NoScene`] listing what was looked for where nothing fits;
/// [`Error::Format`] where a file that would tell is damaged.
pub fn detect_format(path: &Path) -> Result<Format> {
    std::fs::metadata(path).map_err(|source| Error::io(path, source))?;
    for layout in LAYOUTS {
        if (layout.is_at)(path)? {
            return Ok(Format(layout.name));
        }
    }
    let known_by: Vec<&str> = LAYOUTS.iter().map(|layout| layout.known_by).collect();
    Err(Error::NoScene { path: path.to_owned(), looked_for: known_by.join("; ") })
}

/// Finds the views of a scene in the given layout, before any pixel is read.
///
/// # Errors
/// Those of the layout's reader.
pub(super) fn find_views(format: Format, path: &Path, options: &ReadOptions) -> Result<RawScene> {
    let layout = LAYOUTS.iter().find(|layout| layout.name == format.0).unwrap_or(&&dvr::LAYOUT);
    (layout.find)(path, options)
}

/// Whether `path` holds several objects in the DVR layout, rather than a scene.
///
/// # Errors
/// [`Error::Io`] where a folder or list cannot be read, [`Error::Format`] where a list names an object without a
/// folder.
pub fn is_object_dataset(path: &Path) -> Result<bool> {
    let is_scene = || cameras_file(path).is_some() || !detect_format(path).is_ok_and(|format| format == Format::DVR);
    Ok(path.is_dir() && !is_scene() && object_folders(path)?.len() > 1)
}
