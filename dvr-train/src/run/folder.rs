//! The folder of a run: what lies where.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use dvr_core::files::{Claim, FolderKind, OutputFolder, holds};

use super::checkpoint::Checkpoint;
use crate::error::{Error, Result};

/// All that a run may write.
const FILES: [&str; 12] = [
    "best.ckpt",
    "cameras.json",
    "config.json",
    "last.ckpt",
    "mesh.glb",
    "mesh.ply",
    "metrics.csv",
    "metrics.json",
    "preview.png",
    "report.html",
    "scene.dvr",
    "view_color.safetensors",
];

/// Where the parts of a run lie.
#[derive(Clone, Debug)]
pub struct RunFolder {
    root: PathBuf,
}

impl RunFolder {
    /// Names a folder; nothing is touched.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The folder itself.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The newest checkpoint.
    pub fn last(&self) -> PathBuf {
        self.root.join("last.ckpt")
    }

    /// The checkpoint with the best validation.
    pub fn best(&self) -> PathBuf {
        self.root.join("best.ckpt")
    }

    /// The field alone, compact: for grid fields.
    pub fn scene_file(&self) -> PathBuf {
        self.root.join("scene.dvr")
    }

    /// What its colour changes by with the viewing direction: for grid fields.
    pub fn view_color(&self) -> PathBuf {
        self.root.join("view_color.safetensors")
    }

    /// Takes away what the colour of an earlier field changed by with the viewing direction.
    ///
    /// # Errors
    /// When the file cannot be removed.
    pub(crate) fn forget_view_color(&self) -> Result<()> {
        let path = self.view_color();
        match std::fs::remove_file(&path) {
            Err(problem) if problem.kind() != ErrorKind::NotFound => {
                Err(Error::NotStored { problem: format!("{}: {problem}", path.display()) })
            }
            _ => Ok(()),
        }
    }

    /// The refined cameras, as nerfstudio's `transforms.json`, in the scene's own coordinates.
    pub fn cameras(&self) -> PathBuf {
        self.root.join("cameras.json")
    }

    /// The configuration, for people to read.
    pub fn config(&self) -> PathBuf {
        self.root.join("config.json")
    }

    /// The curves.
    pub fn metrics_csv(&self) -> PathBuf {
        self.root.join("metrics.csv")
    }

    /// The final figures.
    pub fn metrics_json(&self) -> PathBuf {
        self.root.join("metrics.json")
    }

    /// The mesh with vertex colours, as PLY.
    pub fn mesh_ply(&self) -> PathBuf {
        self.root.join("mesh.ply")
    }

    /// The same mesh as GLB.
    pub fn mesh_glb(&self) -> PathBuf {
        self.root.join("mesh.glb")
    }

    /// The report, a page for a browser.
    pub fn report(&self) -> PathBuf {
        self.root.join("report.html")
    }

    /// Input, render, depth and normals side by side.
    pub fn preview(&self) -> PathBuf {
        self.root.join("preview.png")
    }

    /// Folder of the masks that were found where the scene had none: for each view its name with `.png`.
    pub fn masks(&self) -> PathBuf {
        self.root.join("masks")
    }

    /// Whether the folder was made for a run.
    pub fn is_run(&self) -> bool {
        holds(&self.root, FolderKind::Run)
    }

    /// Whether a new run may have the folder; nothing is touched.
    ///
    /// # Errors
    /// As [`RunFolder::create`], or, with `may_replace`, as [`RunFolder::replace`].
    pub fn check(&self, may_replace: bool) -> Result<()> {
        Ok(OutputFolder::check(&self.root, FolderKind::Run, self.claim(may_replace), &FILES)?)
    }

    /// Makes the folder of a new run. It belongs to this process until the value that is returned is dropped.
    ///
    /// A run that was killed before its first checkpoint is no obstacle: nothing is lost when it starts anew.
    ///
    /// # Errors
    /// When the folder has files in it that are not a run's, holds a run, is written to by another process, or cannot be
    /// made or written to.
    pub fn create(&self) -> Result<OutputFolder> {
        Ok(OutputFolder::claim(&self.root, FolderKind::Run, self.claim(false), &FILES)?)
    }

    /// [`RunFolder::create`], where an earlier run may be replaced: its files are removed, and nothing else.
    ///
    /// # Errors
    /// As [`RunFolder::create`], but where the folder holds a run.
    pub fn replace(&self) -> Result<OutputFolder> {
        Ok(OutputFolder::claim(&self.root, FolderKind::Run, self.claim(true), &FILES)?)
    }

    /// Takes the folder of a run to write to it. It belongs to this process until the value that is returned is dropped.
    ///
    /// # Errors
    /// When the folder does not hold a run, is written to by another process, or cannot be written to.
    pub fn resume(&self) -> Result<OutputFolder> {
        Ok(OutputFolder::claim(&self.root, FolderKind::Run, Claim::Continue, &FILES)?)
    }

    fn claim(&self, may_replace: bool) -> Claim {
        if may_replace || (self.is_run() && !self.last().exists()) { Claim::Replace } else { Claim::New }
    }

    /// The checkpoint that stands for the run: the best, or the last where nothing was validated.
    ///
    /// # Errors
    /// When there is none or it cannot be read.
    pub fn load(&self) -> Result<Checkpoint> {
        if self.best().exists() { Checkpoint::load(&self.best()) } else { Checkpoint::load(&self.last()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_of_a_run_belongs_to_it() {
        let run = RunFolder::new("run");
        let paths = [
            run.best(),
            run.cameras(),
            run.config(),
            run.last(),
            run.mesh_glb(),
            run.mesh_ply(),
            run.metrics_csv(),
            run.metrics_json(),
            run.preview(),
            run.report(),
            run.scene_file(),
            run.view_color(),
        ];
        assert_eq!(paths.map(|path| path.strip_prefix("run").unwrap().to_owned()), FILES.map(PathBuf::from));
    }

    #[test]
    fn a_run_is_not_replaced_by_accident_but_one_without_a_checkpoint_starts_anew() {
        let parent = tempfile::tempdir().unwrap();
        let run = RunFolder::new(parent.path().join("run"));
        assert!(!run.is_run() && run.resume().is_err());
        drop(run.create().unwrap());
        assert!(run.is_run());
        std::fs::write(run.config(), "{}").unwrap();
        drop(run.create().unwrap());
        assert!(!run.config().exists(), "it starts anew");
        std::fs::write(run.last(), "a checkpoint").unwrap();
        let refused = run.create().unwrap_err().to_string();
        assert!(refused.contains("already holds a run") && run.check(false).is_err() && run.last().exists());
        drop(run.resume().unwrap());
        assert!(run.last().exists());
        drop(run.replace().unwrap());
        assert!(!run.last().exists());
    }
}
