//! The folder of a run: what lies where.

use std::path::{Path, PathBuf};

use super::checkpoint::Checkpoint;
use crate::error::{Error, Result};

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

    /// Makes an empty folder for a new run.
    ///
    /// # Errors
    /// When it cannot be made, cannot be written to, or already holds a run.
    pub fn create(&self) -> Result<()> {
        if self.last().exists() {
            return Err(Error::FolderInUse { path: self.root.clone() });
        }
        std::fs::create_dir_all(&self.root).map_err(|e| dvr_core::Error::io(&self.root, e))?;
        Ok(())
    }

    /// Removes what an earlier run left, and nothing else.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn clear(&self) -> Result<()> {
        let files = [
            self.last(),
            self.best(),
            self.scene_file(),
            self.cameras(),
            self.config(),
            self.metrics_csv(),
            self.metrics_json(),
            self.mesh_ply(),
            self.mesh_glb(),
            self.preview(),
            self.report(),
        ];
        for file in files.into_iter().filter(|file| file.exists()) {
            std::fs::remove_file(&file).map_err(|e| dvr_core::Error::io(&file, e))?;
        }
        Ok(())
    }

    /// The checkpoint that stands for the run: the best, or the last where nothing was validated.
    ///
    /// # Errors
    /// When there is none or it cannot be read.
    pub fn load(&self) -> Result<Checkpoint> {
        if self.best().exists() { Checkpoint::load(&self.best()) } else { Checkpoint::load(&self.last()) }
    }
}
