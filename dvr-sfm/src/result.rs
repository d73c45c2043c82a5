//! What was found.

use std::path::{Path, PathBuf};

use dvr_core::Similarity;
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
    /// The pictures of every model that COLMAP made, largest first. The first is taken. None where sets were joined, each of
    /// which has its cameras.
    pub model_sizes: Vec<usize>,
    /// Points that it triangulated.
    pub points: usize,
    /// Their mean reprojection error in pixels.
    pub mean_error_px: f64,
    /// Pictures that have a mask.
    pub masks: usize,
    /// Sets of photographs in different poses of the object that were joined; none where there is one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sets: Vec<PlacedSet>,
    /// Seconds of this and earlier tries, step by step.
    pub seconds: Vec<(String, f64)>,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// A set of photographs that shows the object in one pose, placed among the others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlacedSet {
    /// Its name, which its pictures begin with.
    pub name: String,
    /// Its pictures.
    pub pictures: usize,
    /// Points of the object that its cameras and those of the sets before it triangulated; of the first set, none.
    pub shared_points: usize,
    /// Of these, the points that agree about where it is.
    pub agreeing_points: usize,
    /// The root mean square distance of those that agree, as a share of the size of the object.
    pub distance_share: f64,
    /// Takes the world of its own cameras to that of the first set.
    pub to_first: Similarity,
}

impl FoundCameras {
    /// Those of a folder; `None` where it has none, or is not finished.
    pub fn read(folder: &Path) -> Option<Self> {
        let text = dvr_core::files::read_text(&folder.join(FILE)).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// What to read as the scene in a folder of cameras: COLMAP's model, which says which picture shows which point; of
    /// several sets, `transforms.json`.
    pub fn scene(&self, folder: &Path) -> PathBuf {
        if self.sets.is_empty() { folder.join("sparse/0") } else { folder.join("transforms.json") }
    }
}
