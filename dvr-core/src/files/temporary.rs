//! Files and folders under temporary names: what a program that ends at once has to remove.
//!
//! A program that ends by returning removes them as they are dropped. One that is ended by a second Ctrl-C drops
//! nothing, so their names are kept here.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The temporary names of this process.
static NAMES: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// How often a folder is removed that does not go.
const ATTEMPTS: usize = 100;

fn names() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    NAMES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary name, kept until it is dropped.
#[derive(Debug)]
pub(crate) struct TemporaryName(PathBuf);

impl TemporaryName {
    /// Makes something under a temporary name, which `path` tells of it. No moment lies between the two at which
    /// [`remove_temporary_files`] would miss it.
    ///
    /// # Errors
    /// Those of `make`.
    pub(crate) fn of<T>(
        make: impl FnOnce() -> io::Result<T>,
        path: impl FnOnce(&T) -> PathBuf,
    ) -> io::Result<(T, Self)> {
        let mut names = names();
        let made = make()?;
        let path = path(&made);
        names.insert(path.clone());
        Ok((made, Self(path)))
    }
}

impl Drop for TemporaryName {
    fn drop(&mut self) {
        names().remove(&self.0);
    }
}

/// Removes what this process has under temporary names. The program must end after it: what is being written is gone,
/// and nothing new can be begun.
pub fn remove_temporary_files() {
    let names = names();
    for path in names.iter() {
        // What cannot be removed is left; the program ends all the same.
        if path.is_dir() {
            remove_folder(path);
        } else {
            let _ = std::fs::remove_file(path);
        }
    }
    // Whoever wants to begin a file now waits for the end.
    std::mem::forget(names);
}

/// Removes a folder that other threads may be writing to: it is moved away first, so that their names lead nowhere.
/// (Removed in place, it gets new files after it was listed, and stays.)
fn remove_folder(path: &Path) {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let aside = path.with_file_name(format!(".removed{name}"));
    // Who had found the folder before it was moved may still put a file there, and who makes folders makes it again.
    for _ in 0..ATTEMPTS {
        let _ = std::fs::rename(path, &aside);
        let _ = std::fs::remove_dir_all(&aside);
        if !path.exists() && !aside.exists() {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_known_as_long_as_it_lives() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(".a.tmp");
        let (_, name) = TemporaryName::of(|| std::fs::write(&path, b"half"), |()| path.clone()).unwrap();
        assert!(names().contains(&path));
        drop(name);
        assert!(!names().contains(&path));
        assert!(TemporaryName::of(|| Err::<(), _>(io::Error::other("full")), |()| path.clone()).is_err());
        assert!(!names().contains(&path));
    }
    #[test]
    fn a_folder_goes_while_threads_write_to_it() {
        use std::sync::atomic::{AtomicBool, Ordering};
        let folder = tempfile::tempdir().unwrap();
        let partial = folder.path().join(".a.partial");
        let is_over = AtomicBool::new(false);
        for _ in 0..20 {
            std::fs::create_dir(&partial).unwrap();
            is_over.store(false, Ordering::Relaxed);
            std::thread::scope(|scope| {
                for thread in 0..4 {
                    let (partial, is_over) = (&partial, &is_over);
                    scope.spawn(move || {
                        for i in 0.. {
                            let was_written = std::fs::write(partial.join(format!("{thread}_{i}")), "").is_ok();
                            if !was_written || is_over.load(Ordering::Relaxed) {
                                break;
                            }
                        }
                    });
                }
                std::thread::sleep(std::time::Duration::from_millis(2));
                remove_folder(&partial);
                is_over.store(true, Ordering::Relaxed);
            });
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        }
    }
}
