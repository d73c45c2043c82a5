//! Files of pixels, and writing any file so that half of it is never seen.
//!
//! Photographs and masks are PNG or JPEG (WebP, BMP, TIFF and GIF are read as well), depth maps and float renders are
//! OpenEXR. Every reader takes an error back to the file's name; none panics on a damaged file.

mod atomic;
mod exr_file;
mod picture;
mod scratch;

pub use atomic::{write_atomically, write_bytes_atomically};
pub use exr_file::{read_depth_exr, write_depth_exr, write_rgb_exr};
pub(crate) use picture::image_size;
pub use picture::{Photo, read_mask, read_photo, read_rgb, write_gray_png, write_rgb_png, write_rgba_png};
pub use scratch::ScratchBytes;
pub(crate) use scratch::ScratchFile;

use std::path::Path;

use crate::error::{Error, Result};

/// The whole file.
///
/// # Errors
/// [`Error::Io`] where the file is missing or not readable.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|source| Error::io(path, source))
}

/// The whole file as text.
///
/// # Errors
/// [`Error::Io`] where the file is missing or not readable, [`Error::Format`] where it is not UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read_bytes(path)?).map_err(|_| {
        Error::format(path, "the file is not text", "Check that this is the file that was meant, and save it as UTF-8.")
    })
}
