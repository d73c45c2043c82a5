//! One process per folder: a lock file.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::fault;
use super::temporary::TemporaryName;

/// Name of the lock file.
pub(super) const LOCK: &str = "dvr-folder.lock";

/// Held as long as this value lives. The system lets go of it when the process ends, however it ends: the file that a
/// killed process leaves is no obstacle.
#[derive(Debug)]
pub(super) struct FolderLock {
    path: PathBuf,
    /// The lock goes with it.
    _file: File,
    /// A process that ends at once takes the file along.
    _name: TemporaryName,
}

impl FolderLock {
    /// Takes the lock of a folder; `None` where another process has it.
    ///
    /// On file systems without locks there is nothing to take, and it counts as taken.
    pub fn take(folder: &Path) -> io::Result<Option<Self>> {
        let path = folder.join(LOCK);
        loop {
            fault::point()?;
            let file = OpenOptions::new().create(true).truncate(false).write(true).open(&path)?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => return Ok(None),
                Err(TryLockError::Error(error)) if error.kind() != io::ErrorKind::Unsupported => return Err(error),
                _ => {}
            }
            // The process that had the lock may have removed the file between the two calls: then this lock locks nothing.
            if is_at(&file, &path)? {
                let ((), _name) = TemporaryName::of(|| Ok(()), |()| path.clone())?;
                return Ok(Some(Self { path, _file: file, _name }));
            }
        }
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        if !fault::is_dead() {
            // Where it cannot be removed it stays, unlocked.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Whether `path` still leads to this file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let ours = file.metadata()?;
    match std::fs::symlink_metadata(path) {
        Ok(found) => Ok((found.dev(), found.ino()) == (ours.dev(), ours.ino())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

/// Other systems remove no file that is open.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> io::Result<bool> {
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_lock_and_a_file_that_was_left_is_no_obstacle() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(LOCK), "left by a dead process").unwrap();
        let lock = FolderLock::take(folder.path()).unwrap().expect("nobody holds it");
        assert!(FolderLock::take(folder.path()).unwrap().is_none(), "one at a time");
        drop(lock);
        assert!(!folder.path().join(LOCK).exists());
        assert!(FolderLock::take(folder.path()).unwrap().is_some());
    }

    #[test]
    fn of_many_that_take_turns_one_holds_it_at_a_time() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        let folder = tempfile::tempdir().unwrap();
        let (holders, turns) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let take_turns = || {
            for _ in 0..500 {
                if let Some(lock) = FolderLock::take(folder.path()).unwrap() {
                    assert_eq!(holders.fetch_add(1, Ordering::SeqCst), 0, "two hold it");
                    turns.fetch_add(1, Ordering::SeqCst);
                    holders.fetch_sub(1, Ordering::SeqCst);
                    drop(lock);
                }
            }
        };
        std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(take_turns))));
        assert!(turns.into_inner() > 0);
    }
}
