//! Folders of results: what in them is ours, and what is the user's.
//!
//! A folder that this program fills has a manifest, which says what the folder is and lists the files that belong to it.
//! Nothing else is ever replaced or removed. It is written before the first of these files, into a folder that is new or
//! empty: whatever is killed when, no file of ours is without its manifest, and no file of the user's is in it.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::atomic::sync_folder;
use super::fault;
use super::folder_lock::{FolderLock, LOCK};
use super::leftovers::{folder_of, is_temporary, remove_leftovers};
use super::manifest::{MANIFEST, Manifest, VERSION, leads_out};
use crate::error::{Error, OutputError, Result};
use crate::folder_kind::FolderKind;

/// How long a process waits for others that take a shared folder, which is a matter of milliseconds.
const PATIENCE: Duration = Duration::from_secs(10);

/// How a folder is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Claim {
    /// It is missing or empty.
    New,
    /// It is missing or empty, or holds results of the same kind, which are removed.
    Replace,
    /// It holds results of the same kind, which are added to.
    Continue,
    /// It is missing or empty, or holds results of the same kind, which are added to.
    NewOrContinue,
}

/// A folder of results that this process alone writes to, as long as this value lives.
#[derive(Debug)]
#[must_use]
pub struct OutputFolder {
    root: PathBuf,
    manifest: Manifest,
    _lock: FolderLock,
}

impl OutputFolder {
    /// Whether a folder may be taken, as far as that is known without taking it; nothing is touched. `files` are the
    /// paths within it that are going to be written.
    ///
    /// # Errors
    /// [`OutputError`] where the folder or a file in it is not ours to touch, [`Error::Io`] where it cannot be read,
    /// [`Error::Format`] where its manifest is broken.
    pub fn check<S: AsRef<str>>(root: &Path, kind: FolderKind, claim: Claim, files: &[S]) -> Result<()> {
        Self::known_files(root, kind, claim, files).map(drop)
    }

    /// Takes a folder: makes it where it is missing, locks it, removes what a killed process left half-written, and, with
    /// [`Claim::Replace`], what its manifest lists.
    ///
    /// # Errors
    /// As [`OutputFolder::check`]; [`OutputError::Locked`] where another process writes to it; [`Error::Io`] where it
    /// cannot be written to.
    pub fn claim<S: AsRef<str>>(root: &Path, kind: FolderKind, claim: Claim, files: &[S]) -> Result<Self> {
        Self::check(root, kind, claim, files)?;
        let refused = |source| Error::io(root, source);
        fault::point().and_then(|()| std::fs::create_dir_all(root)).map_err(refused)?;
        sync_folder(folder_of(root)).map_err(refused)?;
        let lock = FolderLock::take(root).map_err(refused)?;
        let _lock = lock.ok_or_else(|| OutputError::Locked { path: root.to_owned() })?;
        // Again, now that nobody else writes.
        let mut known = Self::known_files(root, kind, claim, files)?;
        remove_leftovers(root, None);
        if claim == Claim::Replace {
            remove_files(root, &known)?;
            known.clear();
        }
        let added: Vec<&str> = files.iter().map(S::as_ref).filter(|file| !known.iter().any(|k| k == file)).collect();
        known.extend(added.into_iter().map(str::to_owned));
        let folder = Self { root: root.to_owned(), manifest: Manifest { version: VERSION, kind, files: known }, _lock };
        folder.manifest.write(root)?;
        Ok(folder)
    }

    /// [`OutputFolder::claim`] with [`Claim::NewOrContinue`] for a folder that several processes fill, each with files of
    /// its own: it is locked only meanwhile.
    ///
    /// # Errors
    /// As [`OutputFolder::claim`].
    pub fn share<S: AsRef<str>>(root: &Path, kind: FolderKind, files: &[S]) -> Result<()> {
        let start = Instant::now();
        loop {
            match Self::claim(root, kind, Claim::NewOrContinue, files) {
                Err(Error::Output(OutputError::Locked { .. })) if start.elapsed() < PATIENCE => {
                    std::thread::sleep(Duration::from_millis(20));
                }
                claimed => return claimed.map(drop),
            }
        }
    }

    /// Enters more files that are going to be written, by their paths within the folder.
    ///
    /// # Errors
    /// [`OutputError::FileThere`] where one is there that is not ours, [`Error::FolderName`] where one would lie outside;
    /// [`Error::Io`] where the folder cannot be written to.
    pub fn add<S: AsRef<str>>(&mut self, files: &[S]) -> Result<()> {
        let kind = self.manifest.kind;
        let mut known = Self::known_files(&self.root, kind, Claim::Continue, files)?;
        let added: Vec<&str> = files.iter().map(S::as_ref).filter(|file| !known.iter().any(|k| k == file)).collect();
        known.extend(added.into_iter().map(str::to_owned));
        self.manifest.files = known;
        self.manifest.write(&self.root)
    }

    /// Removes all that belongs to the folder, and the folder where nothing else is in it.
    ///
    /// # Errors
    /// [`Error::Io`] where a file cannot be removed.
    pub fn remove(self) -> Result<()> {
        remove_files(&self.root, &self.manifest.files)?;
        remove_file(&self.root.join(MANIFEST))?;
        let root = self.root.clone();
        drop(self);
        match std::fs::remove_dir(&root) {
            Err(error) if error.kind() != ErrorKind::DirectoryNotEmpty => Err(Error::io(&root, error)),
            _ => Ok(()),
        }
    }

    /// The files that belong to a folder, none where it is missing or empty, unless it may not be taken.
    fn known_files<S: AsRef<str>>(root: &Path, wanted: FolderKind, claim: Claim, files: &[S]) -> Result<Vec<String>> {
        let path = root.to_owned();
        let manifest = Manifest::read(root)?;
        match &manifest {
            None if claim == Claim::Continue => return Err(OutputError::Missing { path, wanted }.into()),
            None if !is_empty(root)? => return Err(OutputError::NotOurs { path, wanted }.into()),
            None => {}
            Some(Manifest { kind: found, .. }) if *found != wanted => {
                return Err(OutputError::OtherKind { path, found: *found, wanted }.into());
            }
            Some(_) if claim == Claim::New => return Err(OutputError::InUse { path, kind: wanted }.into()),
            Some(_) => {}
        }
        let known = manifest.map_or_else(Vec::new, |manifest| manifest.files);
        for file in files.iter().map(S::as_ref) {
            if leads_out(file) {
                return Err(Error::FolderName { what: "file", name: file.to_owned() });
            }
            let is_ours = known.iter().any(|k| k == file) && is_plain_file(root, Path::new(file));
            if !is_ours && std::fs::symlink_metadata(root.join(file)).is_ok() {
                return Err(OutputError::FileThere { path: root.join(file) }.into());
            }
        }
        Ok(known)
    }
}

/// Whether there is a manifest of this kind in the folder.
pub fn holds(root: &Path, kind: FolderKind) -> bool {
    Manifest::read(root).is_ok_and(|manifest| manifest.is_some_and(|manifest| manifest.kind == kind))
}

/// Whether nothing is in a folder but what a process that was killed at its very start leaves; also where it is missing.
fn is_empty(root: &Path) -> Result<bool> {
    let entries = match std::fs::read_dir(root) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
        entries => entries.map_err(|source| Error::io(root, source))?,
    };
    for entry in entries {
        let name = entry.map_err(|source| Error::io(root, source))?.file_name();
        if !name.to_str().is_some_and(|name| name == LOCK || is_temporary(name)) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Whether a path within `root` leads to a file, without a link on the way.
fn is_plain_file(root: &Path, file: &Path) -> bool {
    let found = |path: &Path| std::fs::symlink_metadata(root.join(path));
    let mut folders = file.ancestors().skip(1).filter(|folder| !folder.as_os_str().is_empty());
    folders.all(|folder| found(folder).is_ok_and(|found| found.is_dir()))
        && found(file).is_ok_and(|found| found.is_file())
}

/// Removes files within `root`. What became a folder or a link, or lies behind a link, was not written by us and stays.
fn remove_files(root: &Path, files: &[String]) -> Result<()> {
    let plain = files.iter().filter(|file| is_plain_file(root, Path::new(file)));
    plain.into_iter().try_for_each(|file| remove_file(&root.join(file)))
}

fn remove_file(path: &Path) -> Result<()> {
    fault::point().and_then(|()| std::fs::remove_file(path)).map_err(|source| Error::io(path, source))
}

#[cfg(test)]
mod tests {
    use super::super::fault::{Fault, inject};
    use super::*;

    const FILES: [&str; 2] = ["a.txt", "charts/b.txt"];

    fn claim(root: &Path, how: Claim) -> Result<OutputFolder> {
        OutputFolder::claim(root, FolderKind::Run, how, &FILES)
    }

    fn refusal(result: Result<OutputFolder>) -> OutputError {
        match result.unwrap_err() {
            Error::Output(error) => error,
            other => panic!("{other}"),
        }
    }

    /// A folder with both of its files.
    fn filled(parent: &Path) -> PathBuf {
        let root = parent.join("run");
        drop(claim(&root, Claim::New).unwrap());
        std::fs::create_dir(root.join("charts")).unwrap();
        FILES.iter().for_each(|file| std::fs::write(root.join(file), "ours").unwrap());
        root
    }

    #[test]
    fn a_folder_is_new_or_empty_or_of_the_same_kind() {
        let parent = tempfile::tempdir().unwrap();
        let root = filled(parent.path());
        assert!(matches!(refusal(claim(&root, Claim::New)), OutputError::InUse { .. }));
        drop(claim(&root, Claim::Continue).unwrap());
        assert!(root.join("a.txt").exists());
        let as_renders = OutputFolder::claim(&root, FolderKind::Renders, Claim::Replace, &FILES);
        assert!(matches!(refusal(as_renders), OutputError::OtherKind { found: FolderKind::Run, .. }));
        let photos = parent.path().join("photos");
        std::fs::create_dir(&photos).unwrap();
        assert!(matches!(refusal(claim(&photos, Claim::Continue)), OutputError::Missing { .. }));
        std::fs::write(photos.join("a.txt"), "the user's").unwrap();
        for how in [Claim::New, Claim::Replace, Claim::NewOrContinue] {
            assert!(matches!(refusal(claim(&photos, how)), OutputError::NotOurs { .. }), "{how:?}");
        }
        assert_eq!(std::fs::read_dir(&photos).unwrap().count(), 1, "nothing was touched");
        assert!(matches!(claim(&photos.join("a.txt/run"), Claim::New), Err(Error::Io { .. })));
    }

    #[test]
    fn replacing_removes_what_the_manifest_lists_and_nothing_else() {
        let parent = tempfile::tempdir().unwrap();
        let root = filled(parent.path());
        std::fs::write(root.join("notes.txt"), "the user's").unwrap();
        let new = OutputFolder::claim(&root, FolderKind::Run, Claim::Replace, &["a.txt"]).unwrap();
        assert!(FILES.iter().all(|file| !root.join(file).exists()) && root.join("notes.txt").exists());
        std::fs::write(root.join("a.txt"), "ours").unwrap();
        new.remove().unwrap();
        assert!(!root.join("a.txt").exists() && root.join("notes.txt").exists());
    }

    #[test]
    fn a_file_of_the_users_with_a_name_of_ours_is_refused() {
        let parent = tempfile::tempdir().unwrap();
        let root = filled(parent.path());
        std::fs::write(root.join("c.txt"), "the user's").unwrap();
        for how in [Claim::Continue, Claim::Replace, Claim::NewOrContinue] {
            let more = OutputFolder::claim(&root, FolderKind::Run, how, &["a.txt", "c.txt"]);
            assert!(matches!(refusal(more), OutputError::FileThere { path } if path.ends_with("c.txt")));
        }
        assert!(root.join("a.txt").exists(), "refused before anything was removed");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_never_followed() {
        use std::os::unix::fs::symlink;
        let parent = tempfile::tempdir().unwrap();
        let root = filled(parent.path());
        let photos = parent.path().join("photos");
        std::fs::create_dir(&photos).unwrap();
        std::fs::write(photos.join("b.txt"), "the user's").unwrap();
        std::fs::remove_dir_all(root.join("charts")).unwrap();
        symlink(&photos, root.join("charts")).unwrap();
        drop(OutputFolder::claim(&root, FolderKind::Run, Claim::Replace, &["a.txt"]).unwrap());
        assert!(photos.join("b.txt").exists());
        // A manifest elsewhere makes no folder ours.
        let fake = parent.path().join("fake");
        std::fs::create_dir(&fake).unwrap();
        symlink(root.join(MANIFEST), fake.join(MANIFEST)).unwrap();
        assert!(matches!(refusal(claim(&fake, Claim::Replace)), OutputError::NotOurs { .. }));
    }

    #[test]
    fn a_manifest_that_leads_out_of_the_folder_is_refused() {
        let parent = tempfile::tempdir().unwrap();
        let root = filled(parent.path());
        std::fs::write(parent.path().join("photo.png"), "the user's").unwrap();
        for path in ["../photo.png", "/etc/hostname", "charts/../../photo.png", ""] {
            let manifest = Manifest { version: VERSION, kind: FolderKind::Run, files: vec![path.into()] };
            std::fs::write(root.join(MANIFEST), serde_json::to_string(&manifest).unwrap()).unwrap();
            let error = claim(&root, Claim::Replace).unwrap_err().to_string();
            assert!(error.contains(MANIFEST) && error.contains("outside"), "{error}");
        }
        assert!(parent.path().join("photo.png").exists() && root.join("a.txt").exists());
    }

    #[test]
    fn one_process_at_a_time_writes_to_a_folder() {
        let parent = tempfile::tempdir().unwrap();
        let root = parent.path().join("run");
        let first = claim(&root, Claim::New).unwrap();
        assert!(matches!(refusal(claim(&root, Claim::Continue)), OutputError::Locked { .. }));
        drop(first);
        drop(claim(&root, Claim::Continue).unwrap());
    }

    #[test]
    fn several_processes_share_a_folder_and_each_adds_its_files() {
        let parent = tempfile::tempdir().unwrap();
        let root = parent.path().join("evaluation");
        let share = |i: usize| OutputFolder::share(&root, FolderKind::Evaluation, &[format!("{i}.jsonl")]).unwrap();
        std::thread::scope(|scope| (0..8).for_each(|i| drop(scope.spawn(move || share(i)))));
        assert_eq!(Manifest::read(&root).unwrap().unwrap().files.len(), 8);
    }

    #[test]
    fn taking_a_folder_can_be_killed_or_refused_at_any_operation_and_tried_again() {
        for fault in [Fault::Killed, Fault::Refused] {
            for operations in 0.. {
                let parent = tempfile::tempdir().unwrap();
                let root = filled(parent.path());
                std::fs::write(root.join("notes.txt"), "the user's").unwrap();
                let new = parent.path().join("new");
                let injected = inject(fault, operations);
                let results = [claim(&root, Claim::Replace), claim(&new, Claim::New)].map(|claimed| claimed.is_ok());
                let has_struck = injected.has_struck();
                drop(injected);
                assert!(results != [true, true] || !has_struck, "{fault:?} at {operations} is reported");
                drop(claim(&root, Claim::Replace).unwrap());
                drop(claim(&new, Claim::Replace).unwrap());
                let names = |root: &Path| std::fs::read_dir(root).unwrap().count();
                assert_eq!(
                    (names(&root), names(&new)),
                    (3, 1),
                    "manifest, notes and an empty folder; no temporary file"
                );
                if !has_struck {
                    break;
                }
            }
        }
    }
}
