//! The archive: a table of contents, and an entry per array.

use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use zip::ZipArchive;
use zip::write::SimpleFileOptions;

use super::array::{Array, Values};
use super::npy::{NpyHead, write_npy};
use crate::error::{Error, Result};
use crate::files::limits::{ARRAY_BYTES, INFLATION, NPY_HEADER_BYTES, check_limit};
use crate::files::write_bytes_atomically;

const REMEDY: &str = "The file may be truncated: copy it again, or write it anew with numpy.savez.";

/// An `.npz` file that is open for reading.
pub struct NpzFile {
    path: PathBuf,
    archive: ZipArchive<BufReader<File>>,
    /// Bytes of the file.
    length: u64,
    names: Vec<String>,
}

impl NpzFile {
    /// Opens the archive and reads its table of contents.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be opened, [`Error::Format`] where it is not a whole archive.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|source| Error::io(path, source))?;
        let length = file.metadata().map_err(|source| Error::io(path, source))?.len();
        let archive = ZipArchive::new(BufReader::new(file))
            .map_err(|error| Error::format(path, format!("this is not a whole .npz archive ({error})"), REMEDY))?;
        let names = archive
            .file_names()
            .filter_map(|name| Some(npyz::npz::array_name_from_file_name(&name.ok()?)?.to_owned()))
            .collect();
        Ok(Self { path: path.to_owned(), archive, length, names })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the arrays, in the order of the file.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether there is an array of that name.
    pub fn contains(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// Reads an array.
    ///
    /// # Errors
    /// [`Error::Format`] where there is no such array (the error lists those there are), its data are damaged or end
    /// early, or its dtype is not a number; [`Error::TooLarge`] where it has more than [`ARRAY_BYTES`].
    pub fn read(&mut self, name: &str) -> Result<Array> {
        if !self.contains(name) {
            let mut names = self.names.join(", ");
            if let Some((cut, _)) = names.char_indices().nth(200) {
                names.truncate(cut);
                names.push_str(" ...");
            }
            return Err(Error::format(
                &self.path,
                format!("there is no array `{name}`; there is: {names}"),
                "Check that this is the file that was meant.",
            ));
        }
        let wrong = |what: String| Error::format(&self.path, format!("array `{name}` cannot be read ({what})"), REMEDY);
        let entry = self
            .archive
            .by_name(&npyz::npz::file_name_from_array_name(name))
            .map_err(|error| wrong(error.to_string()))?;
        // What the directory says of the entry's length is a claim, too.
        let most = entry.size().min(entry.compressed_size().min(self.length).saturating_mul(INFLATION));
        let mut entry = BufReader::new(entry.take(ARRAY_BYTES + 2 * NPY_HEADER_BYTES));
        let head = NpyHead::read(&mut entry).map_err(wrong)?;
        let what = format!("the size of array `{name}` in bytes");
        check_limit(&self.path, &what, head.bytes_in_memory(), ARRAY_BYTES)?;
        let array = head.read_values(&mut entry, most).map_err(wrong)?;
        // The checksum is compared at the end of the entry.
        std::io::copy(&mut entry, &mut std::io::sink()).map_err(|error| wrong(error.to_string()))?;
        Ok(array)
    }
}

/// Writes named arrays to a compressed archive, as `numpy.savez_compressed` does.
///
/// The file holds no time of writing: the same arrays give the same bytes.
///
/// # Errors
/// [`Error::Io`] where the file cannot be written; [`Error::Format`] where an array's shape and its number of elements
/// disagree.
pub fn write_npz(path: &Path, arrays: &[(&str, &Array)]) -> Result<()> {
    for (name, array) in arrays {
        if array.shape.iter().product::<usize>() != array.len() {
            return Err(Error::format(
                path,
                format!("array `{name}` has shape {:?} but {} elements", array.shape, array.len()),
                "Give as many elements as the shape says.",
            ));
        }
    }
    let bytes = encode(arrays).map_err(|source| Error::io(path, source))?;
    write_bytes_atomically(path, &bytes)
}

fn encode(arrays: &[(&str, &Array)]) -> std::io::Result<Vec<u8>> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().last_modified_time(zip::DateTime::default());
    for (name, array) in arrays {
        zip.start_file(npyz::npz::file_name_from_array_name(name), options.large_file(array.len() > 1 << 28))?;
        match &array.values {
            Values::F32(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::F64(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::I32(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::I64(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::U8(v) => write_npy(&mut zip, &array.shape, v)?,
            Values::Bool(v) => write_npy(&mut zip, &array.shape, v)?,
        }
    }
    Ok(zip.finish()?.into_inner())
}
