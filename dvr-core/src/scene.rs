//! A scene: everything that is known about one object before training.

use std::path::PathBuf;

use glam::DVec3;

use crate::camera::{Camera, Similarity};
use crate::pixels::Picture;
use crate::points::{OccupancySamples, PointCloud};
use crate::raster::{DepthMap, Mask};

/// What a view may be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// May be trained on. The trainer may still hold some of these back for validation.
    Train,
    /// Only for choosing between models.
    Val,
    /// Only for the final figures.
    Test,
}

/// One posed photograph, in object space.
#[derive(Clone, Debug)]
pub struct View {
    /// File stem of the image, unique in its scene.
    pub name: String,
    /// The camera, in object space: z-depths are in object units.
    pub camera: Camera,
    /// sRGB colours as the file holds them, not multiplied by alpha.
    pub image: Picture,
    /// Where the object is.
    pub mask: Mask,
    /// Measured z-depth in object units.
    pub depth: Option<DepthMap>,
    /// What the dataset says the view is for.
    pub split: Split,
}

/// What is known of the true shape, in object space. For evaluation only: training never looks at it.
#[derive(Clone, Debug, Default)]
pub struct GroundTruth {
    /// Points on the true surface, with normals where the file has them.
    pub surface: Option<PointCloud>,
    /// Points in the cube with their occupancy.
    pub occupancy: Option<OccupancySamples>,
}

/// Points that structure from motion found, for the sparse depth loss.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SparsePoints {
    /// The points, in object space.
    pub cloud: PointCloud,
    /// For each point the views that see it, as ascending indices into [`Scene::views`].
    pub visible_in: Vec<Vec<usize>>,
}

/// One object, seen from several sides.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name for reports: the folder's.
    pub name: String,
    /// The folder or file the scene was read from.
    pub source: PathBuf,
    /// Which reader made it, e.g. `DVR`, `NeRF transforms`, `COLMAP`.
    pub format: &'static str,
    /// The views, in the order of the files.
    pub views: Vec<View>,
    /// Takes object space (the unit cube) to the world of the files. Every export goes through it.
    pub object_to_world: Similarity,
    /// Points on the object that come with the cameras: COLMAP's model, or `pcl.npz` of the DVR files.
    pub sparse_points: Option<SparsePoints>,
    /// The true shape, where the dataset has it.
    pub ground_truth: GroundTruth,
    /// What a user should know before training, in plain words.
    pub warnings: Vec<String>,
}

impl Scene {
    /// The views of one split, in order.
    pub fn views_of(&self, split: Split) -> impl Iterator<Item = &View> {
        self.views.iter().filter(move |view| view.split == split)
    }

    /// The direction that is up in most of the pictures, in object space; +y where they disagree.
    pub fn up(&self) -> DVec3 {
        let sum: DVec3 = self.views.iter().map(|view| -view.camera.rotation.row(1)).sum();
        if sum.length() > 0.2 * self.views.len() as f64 { sum.normalize() } else { DVec3::Y }
    }
}
