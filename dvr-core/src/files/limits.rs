//! Limits on what is read, in one place: a small file must not ask for all memory, however much it claims to hold.
//!
//! What a reader allocates follows from the size of its file and these numbers, and stays below a gigabyte for files
//! of ordinary size. A file that asks for more is refused with [`Error::TooLarge`], which names it, what is too large,
//! and the limit. `scene.dvr` and networks have theirs beside their formats: `dvr_grid::grid_file` and
//! `dvr_model::NetworkConfig`.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Bytes of any file that is read as a whole.
pub const FILE_BYTES: u64 = 4 << 30;

/// Pixels of a picture. The largest cameras have 151 million.
pub const PICTURE_PIXELS: u64 = 160_000_000;

/// Bytes of a decoded picture: 134 million pixels with alpha, 89 million of 16 bits per channel.
pub const PICTURE_BYTES: u64 = 512 << 20;

/// Pixels of a JPEG per byte of its file: a block of 64 takes an eighth of a byte at least.
pub const JPEG_PIXELS_PER_BYTE: u64 = 512;

/// Bytes of all channels of an OpenEXR file: 67 million pixels of one channel in single precision.
pub const EXR_BYTES: u64 = 256 << 20;

/// Bytes of an array of an `.npz` file in memory, where half precision and small integers are widened to four: 22
/// million points in single precision.
pub const ARRAY_BYTES: u64 = 256 << 20;

/// Bytes of the header of a `.npy` file, as NumPy has it.
pub const NPY_HEADER_BYTES: u64 = 10_000;

/// Bytes that one deflated byte may become (zlib's own figure).
pub const INFLATION: u64 = 1032;

/// Bytes that a byte of a glTF buffer may become when meshoptimizer's codec compressed it: zeros, in its first version.
pub const MESHOPT_INFLATION: u64 = 64;

/// Vertices, triangles and primitives of a glTF scene whose nodes share meshes. A scene may have as many as its buffers
/// have bytes in any case.
pub const SHARED_ELEMENTS: u64 = 4 << 20;

/// Bytes of all textures of a mesh, four per pixel. What is beyond is left out with a warning.
pub const TEXTURE_BYTES: u64 = 512 << 20;

/// Corners of a polygon that is not convex: cutting it takes time by their square.
pub const POLYGON_CORNERS: usize = 4096;

/// Refuses what is above its limit.
///
/// # Errors
/// [`Error::TooLarge`] with all of it.
pub fn check_limit(path: &Path, what: &str, value: u64, limit: u64) -> Result<()> {
    if value <= limit {
        return Ok(());
    }
    Err(Error::TooLarge { path: path.to_owned(), what: what.to_owned(), value, limit })
}

/// The whole file.
///
/// # Errors
/// [`Error::Io`] where the file is missing or not readable, [`Error::TooLarge`] where it has more than [`FILE_BYTES`].
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let read = || -> std::io::Result<(u64, Vec<u8>)> {
        let file = File::open(path)?;
        let stated = file.metadata()?.len();
        let mut bytes = Vec::new();
        if stated <= FILE_BYTES {
            bytes.reserve_exact(stated as usize);
            // What is not a plain file says nothing of its length.
            file.take(FILE_BYTES + 1).read_to_end(&mut bytes)?;
        }
        Ok((stated.max(bytes.len() as u64), bytes))
    };
    let (length, bytes) = read().map_err(|source| Error::io(path, source))?;
    check_limit(path, "the file's length in bytes", length, FILE_BYTES)?;
    Ok(bytes)
}

/// The whole file as text.
///
/// # Errors
/// As [`read_bytes`]; [`Error::Format`] where the file is not UTF-8.
pub fn read_text(path: &Path) -> Result<String> {
    String::from_utf8(read_bytes(path)?).map_err(|_| {
        Error::format(path, "the file is not text", "Check that this is the file that was meant, and save it as UTF-8.")
    })
}

/// The beginning of a text from a file, for messages.
pub(crate) fn shortened(text: &str) -> String {
    match text.char_indices().nth(80) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_more_bytes_than_are_read_is_refused_before_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sparse");
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        let error = read_bytes(&path).unwrap_err();
        assert!(matches!(error, Error::TooLarge { value, limit: FILE_BYTES, .. } if value == 1 << 40), "{error}");
        std::fs::write(&path, "text").unwrap();
        assert_eq!(read_text(&path).unwrap(), "text");
    }

    #[test]
    fn long_texts_are_cut_between_letters() {
        assert_eq!(shortened("short"), "short");
        let cut = shortened(&"\u{e9}".repeat(100));
        assert_eq!(cut.chars().count(), 83);
    }
}
