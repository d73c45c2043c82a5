//! A scratch file: bytes that need not be in memory, paged in by the system as they are read.

use std::fs::File;
use std::io::{Seek, Write};
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::{Mmap, MmapOptions};

use crate::error::{Error, Result};

/// A private file in the system's temporary folder (`TMPDIR` on Unix) that only ever grows. It has no name, and goes
/// away with the last bytes that refer to it, however the program ends.
#[derive(Debug)]
pub(crate) struct ScratchFile {
    folder: PathBuf,
    file: File,
}

impl ScratchFile {
    /// An empty scratch file.
    ///
    /// # Errors
    /// [`Error::Scratch`] where the temporary folder is missing or read-only.
    pub(crate) fn new() -> Result<Self> {
        let folder = std::env::temp_dir();
        let file = tempfile::tempfile_in(&folder).map_err(|source| refusal(&folder, source))?;
        Ok(Self { folder, file })
    }

    /// Writes `parts` to the end of the file, and gives them back as they lie there.
    ///
    /// # Errors
    /// [`Error::Scratch`] where the disk is full, or the system maps no more pieces of files.
    pub(crate) fn keep<const N: usize>(&mut self, parts: [&[u8]; N]) -> Result<[ScratchBytes; N]> {
        self.append(parts).map_err(|source| refusal(&self.folder, source))
    }

    fn append<const N: usize>(&mut self, parts: [&[u8]; N]) -> std::io::Result<[ScratchBytes; N]> {
        // Not a count of our own: a write that failed half-way has moved the end too.
        let offset = self.file.stream_position()?;
        for part in parts {
            self.file.write_all(part)?;
        }
        let mut end = 0;
        let ranges = parts.map(|part| {
            let start = end;
            end += part.len();
            start..end
        });
        let map = Arc::new(map(&self.file, offset, end)?);
        Ok(ranges.map(|range| ScratchBytes { map: Arc::clone(&map), range }))
    }
}

fn refusal(folder: &Path, source: std::io::Error) -> Error {
    Error::Scratch { folder: folder.to_owned(), source }
}

/// Maps `length` bytes of a scratch file from `offset`, read-only.
#[allow(unsafe_code)]
fn map(file: &File, offset: u64, length: usize) -> std::io::Result<Mmap> {
    // SAFETY: a mapping must not change or shrink while it is borrowed. The file was made by `tempfile_in`, which
    // leaves no name by which another could open it; its bytes in this range are written already, and `ScratchFile`,
    // which alone holds the handle, only ever writes behind them and never truncates.
    unsafe { MmapOptions::new().offset(offset).len(length).map(file) }
}

/// Bytes in a scratch file. A clone refers to the same bytes.
#[derive(Clone, Debug)]
pub struct ScratchBytes {
    map: Arc<Mmap>,
    range: Range<usize>,
}

impl Deref for ScratchBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.map[self.range.clone()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_reads_as_it_was_written_and_outlives_the_file() {
        let mut scratch = ScratchFile::new().unwrap();
        let [a, b] = scratch.keep([&[1, 2, 3], &[4]]).unwrap();
        let long: Vec<u8> = (0..10_000u32).map(|i| i as u8).collect();
        let [c] = scratch.keep([&long]).unwrap();
        drop(scratch);
        assert_eq!((&a[..], &b[..]), (&[1, 2, 3][..], &[4][..]));
        assert!(c[..] == long);
    }

    #[test]
    fn a_refusal_names_the_folder_and_what_it_needs() {
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        let reason = full.to_string();
        let message = refusal("/scratch".as_ref(), full).to_string();
        for part in ["/scratch", &reason, "room", "memory"] {
            assert!(message.contains(part), "{message}");
        }
    }
}
