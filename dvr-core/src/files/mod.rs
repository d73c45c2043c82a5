//! Files of pixels; writing any file so that half of it is never seen, and where nothing of the user's is lost.
//!
//! Photographs and masks are PNG or JPEG (WebP, BMP, TIFF and GIF are read as well), depth maps and float renders are
//! OpenEXR. Every reader takes an error back to the file's name; none panics on a damaged file.

mod atomic;
mod exr_file;
#[doc(hidden)]
pub mod fault;
mod folder_lock;
mod leftovers;
pub mod limits;
mod manifest;
mod output_folder;
mod picture;
mod places;
mod scratch;
mod temporary;

pub use crate::folder_kind::FolderKind;
pub(crate) use atomic::sync_folder;
pub use atomic::{fill_atomically, write_atomically, write_bytes_atomically};
pub use exr_file::{read_depth_exr, write_depth_exr, write_rgb_exr};
pub(crate) use limits::shortened;
pub use limits::{check_limit, read_bytes, read_text};
pub use output_folder::{Claim, OutputFolder, holds};
pub(crate) use picture::image_size;
pub use picture::{
    Photo, UprightPhoto, decoded_picture, encoded_jpeg, read_mask, read_photo, read_rgb, upright_photo, write_gray_png,
    write_jpeg, write_rgb_png, write_rgba_png,
};
pub use places::{check_beside_data, check_file};
pub use scratch::ScratchBytes;
pub(crate) use scratch::ScratchFile;
pub(crate) use temporary::TemporaryName;
pub use temporary::remove_temporary_files;
