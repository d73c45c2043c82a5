//! The scene of a cell on disk: rendered once, and again where it is not what this program renders.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use dvr_core::record::{Digest, RecordKey};
use dvr_stress::{Axis, write_scene};
use serde_json::json;

use crate::commands::kept_row::{Kept, keep, kept};
use crate::commands::provenance::record_key;

/// The scene of a difficulty and a seed.
pub struct StressScene<'a> {
    pub axis: &'a Axis,
    pub difficulty: f64,
    pub seed: u64,
    pub out: &'a Path,
}

impl StressScene<'_> {
    /// Its name, for folders and files.
    pub fn name(&self) -> String {
        format!("{}.{}.{}", self.axis.name, Axis::label(self.difficulty), self.seed)
    }

    /// Its folder.
    pub fn folder(&self) -> PathBuf {
        self.out.join("scenes").join(self.name())
    }

    /// The digest of its files, where these are what this program renders. Axes of gradients have none: their digest is
    /// that of nothing.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn digest(&self) -> Result<Option<Digest>> {
        if self.axis.case(self.difficulty).is_none() {
            return Ok(Some(Digest::of_bytes(&[])));
        }
        if !self.folder().exists() {
            return Ok(None);
        }
        let digest = Digest::of_files(&self.folder(), None)?;
        let is_ours = matches!(kept::<()>(&self.file(), &self.key(digest.clone())?)?, Kept::Row(()));
        Ok(is_ours.then_some(digest))
    }

    /// The digest of its files, which are rendered unless they are there.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn ready(&self) -> Result<Digest> {
        if let Some(digest) = self.digest()? {
            return Ok(digest);
        }
        let case = self.axis.case(self.difficulty).context("an axis of gradients has no scene")?;
        let folder = self.folder();
        if folder.exists() {
            std::fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        write_scene(&case, &self.name(), self.seed, self.out)?;
        let digest = Digest::of_files(&folder, None)?;
        keep(&self.file(), &self.key(digest.clone())?, ())?;
        Ok(digest)
    }

    /// Where it is written down what rendered the files.
    fn file(&self) -> PathBuf {
        self.out.join("cells").join(format!("{}.scene.json", self.name()))
    }

    fn key(&self, files: Digest) -> Result<RecordKey> {
        let Self { axis, difficulty, seed, .. } = self;
        record_key(files, &json!({ "axis": axis.name, "difficulty": difficulty, "seed": seed }), "cpu")
    }
}

#[cfg(test)]
mod tests {
    use dvr_stress::axes;

    use super::*;

    #[test]
    fn a_scene_is_rendered_again_where_its_files_were_changed() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("cells")).unwrap();
        let axes = axes();
        let axis = axes.iter().find(|axis| axis.name == "views").unwrap();
        let scene = StressScene { axis, difficulty: 3.0, seed: 0, out: folder.path() };
        assert_eq!(scene.digest().unwrap(), None, "not there");
        let first = scene.ready().unwrap();
        assert_eq!(scene.digest().unwrap(), Some(first.clone()));
        std::fs::write(scene.folder().join("cameras.npz"), "another program's").unwrap();
        assert_eq!(scene.digest().unwrap(), None);
        assert_eq!(scene.ready().unwrap(), first, "the same bytes");
        // A scene of which nobody knows who rendered it is nobody's.
        std::fs::remove_file(scene.file()).unwrap();
        assert_eq!(scene.digest().unwrap(), None);
    }
}
