//! Write to a temporary name beside the target, sync, rename, sync the folder: a reader sees the old file or the new one,
//! never a part, even after a power cut.
//!
//! Everything that this program writes goes through here.

use std::fs::File;
use std::io::{BufWriter, IntoInnerError, Write};
use std::path::Path;

use super::fault;
use super::leftovers::{folder_of, temporary_beside};
use super::temporary::TemporaryName;
use crate::error::{Error, Result};

/// Writes a file through `content` and puts it at `path` in one step.
///
/// Should `content` fail, or the program be stopped, what stood at `path` stays as it was. A link at `path` is replaced,
/// not followed.
///
/// # Errors
/// [`Error::Io`] where the folder is missing or read-only, the disk is full, or `content` fails.
pub fn write_atomically(path: &Path, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    write_beside(path, content).map_err(|source| Error::io(path, source))
}

/// [`write_atomically`] for content that is in memory already.
///
/// # Errors
/// [`Error::Io`] where the folder is missing or read-only, or the disk is full.
pub fn write_bytes_atomically(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |file| file.write_all(bytes))
}

/// [`write_atomically`] for a file that another program fills: `content` gets the temporary name, at which there is an
/// empty file to be written over.
///
/// # Errors
/// That of `content`, and [`Error::Io`] as [`write_atomically`].
pub fn fill_atomically<E: From<Error>>(
    path: &Path,
    content: impl FnOnce(&Path) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    // What fails in the other program is no failure of this file.
    let mut failure = None;
    let written = put_in_place(path, |file, temporary| match content(temporary) {
        Ok(()) => file.sync_all(),
        Err(error) => {
            failure = Some(error);
            Err(std::io::Error::other("the file was not filled"))
        }
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(written.map_err(|source| Error::io(path, source))?),
    }
}

fn write_beside(path: &Path, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    put_in_place(path, |file, _| fill(file, content))
}

/// Fills a temporary file, which `write` gets with its name, and renames it.
fn put_in_place(path: &Path, write: impl FnOnce(&File, &Path) -> std::io::Result<()>) -> std::io::Result<()> {
    fault::point()?;
    let (mut temporary, _name) = TemporaryName::of(|| temporary_beside(path), |file| file.path().to_owned())?;
    let written = write(temporary.as_file(), temporary.path()).and_then(|()| fault::point());
    // Only the killed leave temporary files; else they are removed as the error leaves this function.
    temporary.disable_cleanup(fault::is_dead());
    written?;
    temporary.persist(path)?;
    sync_folder(folder_of(path))
}

/// Writes the content, and has it on the disk.
fn fill(file: &File, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> std::io::Result<()> {
    let mut writer = BufWriter::new(Faulty(file));
    content(&mut writer)?;
    let Faulty(file) = writer.into_inner().map_err(IntoInnerError::into_error)?;
    fault::point()?;
    file.sync_all()
}

/// A file that takes half of what it is given where a test asks for a fault.
struct Faulty<'f>(&'f File);

impl Write for Faulty<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match fault::point() {
            Ok(()) => self.0.write(bytes),
            Err(error) => self.0.write_all(&bytes[..bytes.len() / 2]).and(Err(error)),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

/// Has the names in a folder on the disk: a renamed file otherwise may be lost in a power cut though it was synced itself.
#[cfg(unix)]
pub(crate) fn sync_folder(folder: &Path) -> std::io::Result<()> {
    use std::io::ErrorKind;
    fault::point()?;
    // A folder may be writable and not readable; some file systems sync no folders.
    let Ok(folder) = File::open(folder) else { return Ok(()) };
    match folder.sync_all() {
        Err(error) if !matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) => Err(error),
        _ => Ok(()),
    }
}

/// Other systems than Unix open no folders.
#[cfg(not(unix))]
pub(crate) fn sync_folder(_: &Path) -> std::io::Result<()> {
    fault::point()
}

#[cfg(test)]
mod tests {
    use super::super::fault::{Fault, inject};
    use super::super::leftovers::remove_leftovers;
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_rubbish() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes_atomically(&path, b"old").unwrap();
        let failed = write_atomically(&path, |file| {
            file.write_all(b"half of the n")?;
            Err(std::io::Error::other("the source broke"))
        });
        assert!(failed.unwrap_err().to_string().contains("a.txt: the source broke"));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write_bytes_atomically(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_file_that_another_program_fills_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let failed = fill_atomically(&path, |temporary| {
            std::fs::write(temporary, b"half").unwrap();
            assert!(!path.exists());
            Err(Error::FolderName { what: "file", name: "broke".to_owned() })
        });
        assert!(failed.unwrap_err().to_string().contains("broke"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        fill_atomically(&path, |temporary| std::fs::write(temporary, b"all").map_err(|e| Error::io(temporary, e)))
            .unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"all");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    /// Replaces a file with content of several writes, with a fault at each operation in turn; returns how many there are.
    fn with_every_fault(fault: Fault, check: impl Fn(&Path, Result<()>)) -> usize {
        let long = vec![7u8; 20_000];
        for operations in 0.. {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.bin");
            write_bytes_atomically(&path, b"old").unwrap();
            let injected = inject(fault, operations);
            let written = write_atomically(&path, |file| {
                [b"head".as_slice(), &long, b"tail"].map(|b| file.write_all(b)).into_iter().collect()
            });
            let has_struck = injected.has_struck();
            drop(injected);
            check(&path, written);
            let bytes = std::fs::read(&path).unwrap();
            assert!(bytes == b"old" || bytes.len() == long.len() + 8, "operation {operations}: a part was seen");
            if !has_struck {
                return operations;
            }
        }
        unreachable!("the loop has no end")
    }

    #[test]
    fn whatever_the_system_refuses_the_file_is_old_or_new_and_nothing_stays() {
        let count = with_every_fault(Fault::Refused, |path, written| {
            assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
            if std::fs::read(path).unwrap() == b"old" {
                let error = written.unwrap_err().to_string();
                assert!(error.contains("a.bin: "), "{error}");
            }
        });
        assert!(count >= 6, "create, write, write, sync, rename, sync the folder: {count}");
    }

    #[test]
    fn whenever_the_process_is_killed_the_file_is_old_or_new_and_what_stays_is_known() {
        let count = with_every_fault(Fault::Killed, |path, _| {
            let folder = path.parent().unwrap();
            remove_leftovers(folder, None);
            assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1);
        });
        assert!(count >= 6, "{count}");
    }

    #[cfg(unix)]
    #[test]
    fn a_written_file_is_as_readable_as_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_bytes_atomically(&ours, b"").unwrap();
        std::fs::write(&plain, b"").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = write_bytes_atomically(Path::new("/no/such/folder/a.txt"), b"").unwrap_err();
        assert!(error.to_string().starts_with("/no/such/folder/a.txt: "));
    }
}
