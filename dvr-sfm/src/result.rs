//! What was found.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// The file of [`FoundCameras`] in its folder.
pub(crate) const FILE: &str = "sfm.json";

/// The cameras of photographs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundCameras {
    /// Photographs and options that they were found from, as a digest.
    pub key: String,
    /// The program that found them, with its version.
    pub engine: String,
    /// Pictures that have a camera.
    pub placed: usize,
    /// Pictures that have none, by their names.
    pub not_placed: Vec<String>,
    /// The pictures of every model that COLMAP made, largest first. The first is taken.
    pub model_sizes: Vec<usize>,
    /// Points that it triangulated.
    pub points: usize,
    /// Their mean reprojection error in pixels.
    pub mean_error_px: f64,
    /// Pictures that have a mask.
    pub masks: usize,
    /// Seconds of this and earlier tries, step by step.
    pub seconds: Vec<(String, f64)>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl FoundCameras {
    /// Those of a folder; `None` where it has none, or is not finished.
    pub fn read(folder: &Path) -> Option<Self> {
        let text = dvr_core::files::read_text(&folder.join(FILE)).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// What to read as the scene in a folder of cameras: COLMAP's model, which says which picture shows which point.
    pub fn scene(folder: &Path) -> PathBuf {
        folder.join("sparse/0")
    }
}
