//! The folder of cameras while they are found: what is finished is remembered, and what is half-written lies apart.

use std::path::{Path, PathBuf};
use std::time::Instant;

use dvr_core::files::{Claim, FolderKind, OutputFolder, holds, read_text, write_bytes_atomically};
use serde::{Deserialize, Serialize};

use crate::child::Log;
use crate::error::{Result, SfmError};
use crate::pictures::{Prepared, make_folder_of};
use crate::result::{FILE, FoundCameras};

/// What is half-finished; it is removed at the end.
const WORK: &str = "work";

/// What is finished, in it.
const STATE: &str = "work/state.json";

/// Files that every folder of cameras has, below it.
const FILES: [&str; 8] = [
    FILE,
    STATE,
    "sfm.log",
    "transforms.json",
    "points.ply",
    "sparse/0/cameras.txt",
    "sparse/0/images.txt",
    "sparse/0/points3D.txt",
];

/// What is finished, and what it gave.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct State {
    /// Photographs and options.
    key: String,
    /// Steps with the seconds that they took.
    finished: Vec<(String, f64)>,
    pictures: Vec<Prepared>,
    notes: Vec<String>,
}

/// The folder while cameras are found.
pub(crate) struct Workspace {
    root: PathBuf,
    state: State,
    pub log: Log,
    claim: Option<OutputFolder>,
}

impl Workspace {
    /// Takes a folder for the photographs and options of a key; what was finished for the same is kept.
    ///
    /// # Errors
    /// [`SfmError::OtherPhotographs`] where it has cameras of another key that may not be replaced; [`SfmError::Core`]
    /// where it is not ours, or cannot be written to.
    pub fn open(root: &Path, key: &str, may_replace: bool) -> Result<Self> {
        let has_other = FoundCameras::read(root).is_some_and(|found| found.key != key);
        let is_ours = holds(root, FolderKind::Cameras);
        if has_other && is_ours && !may_replace {
            return Err(SfmError::OtherPhotographs { path: root.to_owned() });
        }
        let state: Option<State> = read_text(&root.join(STATE)).ok().and_then(|text| serde_json::from_str(&text).ok());
        let state = state.filter(|state| state.key == key);
        let how = if has_other { Claim::Replace } else { Claim::NewOrContinue };
        let claim = OutputFolder::claim(root, FolderKind::Cameras, how, &FILES)?;
        let work = root.join(WORK);
        if state.is_none() && is_ours {
            remove(&work)?;
        }
        std::fs::create_dir_all(&work).map_err(|source| refused(&work, source))?;
        let state = state.unwrap_or_else(|| State { key: key.to_owned(), ..State::default() });
        let workspace =
            Self { root: root.to_owned(), state, log: Log::open(&root.join("sfm.log"))?, claim: Some(claim) };
        workspace.save()?;
        Ok(workspace)
    }

    /// A path in the folder of what is half-finished.
    pub fn work(&self, path: &str) -> PathBuf {
        self.root.join(WORK).join(path)
    }

    /// A path in the folder of cameras.
    pub fn at(&self, path: &str) -> PathBuf {
        self.root.join(path)
    }

    pub fn pictures(&self) -> &[Prepared] {
        &self.state.pictures
    }

    pub fn set_pictures(&mut self, pictures: Vec<Prepared>) {
        self.state.pictures = pictures;
    }

    pub fn notes(&self) -> &[String] {
        &self.state.notes
    }

    pub fn note(&mut self, note: String) {
        self.state.notes.push(note);
    }

    pub fn seconds(&self) -> &[(String, f64)] {
        &self.state.finished
    }

    pub fn is_finished(&self, step: &str) -> bool {
        self.state.finished.iter().any(|(name, _)| name == step)
    }

    /// Does a step, unless it is finished; whether it was done now.
    pub fn step(&mut self, name: &str, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<bool> {
        if self.is_finished(name) {
            return Ok(false);
        }
        let start = Instant::now();
        work(self)?;
        self.state.finished.push((name.to_owned(), start.elapsed().as_secs_f64()));
        self.save()?;
        Ok(true)
    }

    fn save(&self) -> Result<()> {
        let path = self.root.join(STATE);
        let json = serde_json::to_string_pretty(&self.state);
        let json = json.map_err(|error| refused(&path, std::io::Error::other(error)))?;
        Ok(write_bytes_atomically(&path, json.as_bytes())?)
    }

    /// Makes an empty folder of what is half-finished, or removes what a killed process left in it.
    pub fn empty(&self, path: &str) -> Result<PathBuf> {
        let folder = self.work(path);
        remove(&folder)?;
        std::fs::create_dir_all(&folder).map_err(|source| refused(&folder, source))?;
        Ok(folder)
    }

    /// Moves a file of what is half-finished to its place in the folder of cameras.
    pub fn move_out(&self, from: &str, to: &str) -> Result<()> {
        let (from, to) = (self.work(from), self.at(to));
        make_folder_of(&to)?;
        // One that is gone was moved by a process that was killed then.
        if from.exists() || !to.exists() {
            std::fs::rename(&from, &to).map_err(|source| refused(&from, source))?;
        }
        Ok(())
    }

    /// Enters files, by their paths below the folder, that are going to be written.
    pub fn announce(&mut self, files: &[String]) -> Result<()> {
        // One lock at a time: the folder's own would keep us out, too.
        self.claim = None;
        let all: Vec<&str> = FILES.iter().copied().chain(files.iter().map(String::as_str)).collect();
        self.claim = Some(OutputFolder::claim(&self.root, FolderKind::Cameras, Claim::NewOrContinue, &all)?);
        Ok(())
    }

    /// Whether nothing is finished yet.
    pub fn is_new(&self) -> bool {
        self.state.finished.is_empty()
    }

    /// Leaves nothing of it, where nothing could be made of the photographs.
    pub fn discard(self) -> Result<()> {
        remove(&self.root.join(WORK))?;
        match self.claim {
            Some(claim) => Ok(claim.remove()?),
            None => Ok(()),
        }
    }

    /// Writes what was found, which makes the folder one of cameras, and removes what is no longer needed.
    pub fn finish(self, found: &FoundCameras) -> Result<()> {
        let path = self.root.join(FILE);
        let json = serde_json::to_string_pretty(found);
        let json = json.map_err(|error| refused(&path, std::io::Error::other(error)))?;
        write_bytes_atomically(&path, json.as_bytes())?;
        remove(&self.root.join(WORK))
    }
}

/// Removes a folder of ours with all that is in it. A link is removed, not followed.
pub(crate) fn remove(folder: &Path) -> Result<()> {
    let gone = match std::fs::symlink_metadata(folder) {
        Err(_) => return Ok(()),
        Ok(found) if found.is_dir() => std::fs::remove_dir_all(folder),
        Ok(_) => std::fs::remove_file(folder),
    };
    gone.map_err(|source| refused(folder, source))
}

pub(crate) fn refused(path: &Path, source: std::io::Error) -> SfmError {
    dvr_core::Error::Io { path: path.to_owned(), source }.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finished_step_is_not_made_again_and_other_photographs_begin_anew() {
        let parent = tempfile::tempdir().unwrap();
        let root = parent.path().join("photos-cameras");
        let mut made = 0;
        let mut open = |key: &str| {
            let mut workspace = Workspace::open(&root, key, false).unwrap();
            workspace.step("features", |workspace| {
                made += 1;
                std::fs::write(workspace.work("database.db"), key).unwrap();
                Ok(())
            })
        };
        assert!(open("a").unwrap());
        assert!(!open("a").unwrap());
        assert!(open("b").unwrap());
        assert_eq!(made, 2);
        assert_eq!(std::fs::read_to_string(root.join("work/database.db")).unwrap(), "b");
    }

    #[test]
    fn cameras_of_other_photographs_are_replaced_only_where_that_is_asked_for() {
        let parent = tempfile::tempdir().unwrap();
        let root = parent.path().join("photos-cameras");
        let found = |key: &str| FoundCameras {
            key: key.to_owned(),
            engine: String::new(),
            placed: 1,
            not_placed: Vec::new(),
            model_sizes: vec![1],
            points: 1,
            mean_error_px: 0.5,
            masks: 0,
            sets: Vec::new(),
            seconds: Vec::new(),
            notes: Vec::new(),
        };
        let mut workspace = Workspace::open(&root, "a", false).unwrap();
        workspace.announce(&["images/x.jpg".to_owned()]).unwrap();
        std::fs::create_dir_all(root.join("images")).unwrap();
        std::fs::write(root.join("images/x.jpg"), "ours").unwrap();
        std::fs::write(root.join("notes.txt"), "the user's").unwrap();
        workspace.finish(&found("a")).unwrap();
        assert!(!root.join("work").exists());
        assert_eq!(FoundCameras::read(&root), Some(found("a")));
        let refusal = Workspace::open(&root, "b", false).err().unwrap();
        assert!(matches!(refusal, SfmError::OtherPhotographs { .. }) && root.join("images/x.jpg").exists());
        drop(Workspace::open(&root, "b", true).unwrap());
        assert!(!root.join("images/x.jpg").exists() && root.join("notes.txt").exists());
        assert_eq!(FoundCameras::read(&root), None);
    }

    #[test]
    fn a_folder_of_the_users_is_left_alone() {
        let photos = tempfile::tempdir().unwrap();
        std::fs::create_dir(photos.path().join("work")).unwrap();
        std::fs::write(photos.path().join("work/a.jpg"), "").unwrap();
        assert!(Workspace::open(photos.path(), "a", true).is_err());
        assert!(photos.path().join("work/a.jpg").exists());
    }
}
