//! Where an object in the DVR layout has its pictures and cameras.

use std::path::{Path, PathBuf};

use super::pairing::{list_files, pictures, sub_folder};
use crate::error::{Error, Result};

/// Names of the folder of images.
pub(super) const IMAGE_FOLDERS: [&str; 5] = ["image", "images", "rgb", "img", "img_choy2016"];

/// The file with an object's cameras, beside its images or among them.
pub(super) fn cameras_file(object: &Path) -> Option<PathBuf> {
    let among = sub_folder(object, &IMAGE_FOLDERS).map(|folder| folder.join("cameras.npz"));
    [Some(object.join("cameras.npz")), among].into_iter().flatten().find(|path| path.is_file())
}

/// The folder of the object's pictures.
///
/// # Errors
/// [`Error::Format`] where there is none, or no picture in it.
pub(super) fn image_folder(root: &Path) -> Result<PathBuf> {
    let folder = sub_folder(root, &IMAGE_FOLDERS).ok_or_else(|| {
        Error::format(
            root,
            "there is no folder of images",
            format!("Put the pictures into one of {}.", IMAGE_FOLDERS.join(", ")),
        )
    })?;
    if list_files(&folder, pictures())?.is_empty() {
        return Err(Error::format(&folder, "there are no pictures", "Put PNG or JPEG files there."));
    }
    Ok(folder)
}
