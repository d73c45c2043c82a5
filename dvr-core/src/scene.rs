//! A scene: everything that is known about one object before training.

use std::path::PathBuf;

use glam::{DVec2, DVec3};

use crate::camera::{Camera, Similarity};
use crate::error::{Error, Result};
use crate::exposure::Exposure;
use crate::pixels::Picture;
use crate::points::{OccupancySamples, PointCloud};
use crate::raster::{DepthMap, Mask};
use crate::region::Region;

/// What a view may be used for: as the dataset says, or as [`Scene::hold_out`] divides what it leaves open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// To be trained on.
    Train,
    /// Only for choices during a run: growth, the end of training, the best checkpoint.
    Val,
    /// Only for the final figures.
    Test,
}

/// What a mask was made from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum MaskSource {
    /// A picture of its own.
    #[default]
    File,
    /// The photograph's alpha channel, or a picture of its own that says the same.
    Alpha,
    /// The photograph's difference from a plain background.
    Background,
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
    /// Where the object is, as the files say; `None` where they do not. Figures are measured against this mask.
    pub mask: Option<Mask>,
    /// What [`refine_masks`](crate::refine_masks) made of `mask`; `None` where it changed nothing.
    pub refined_mask: Option<Mask>,
    /// What `mask` was made from, where there is one.
    pub mask_source: MaskSource,
    /// Measured z-depth in object units.
    pub depth: Option<DepthMap>,
    /// What the view is for.
    pub split: Split,
    /// What takes its colours to the mean exposure of the scene: nothing, unless a run found that the light changes.
    /// `None` where it does and nobody knows how this view was exposed, as of views that are not trained on.
    pub exposure: Option<Exposure>,
}

impl View {
    /// A view to train on, whose mask, if any, comes from a file; without depth.
    pub fn new(name: impl Into<String>, camera: Camera, image: Picture, mask: impl Into<Option<Mask>>) -> Self {
        Self {
            name: name.into(),
            camera,
            image,
            mask: mask.into(),
            refined_mask: None,
            mask_source: MaskSource::File,
            depth: None,
            split: Split::Train,
            exposure: Some(Exposure::default()),
        }
    }

    /// The mask that training uses: the refined one where there is one, else the one given.
    pub fn training_mask(&self) -> Option<&Mask> {
        self.refined_mask.as_ref().or(self.mask.as_ref())
    }

    /// The camera with the mask that training uses; `None` without a mask.
    pub fn training_pair(&self) -> Option<(&Camera, &Mask)> {
        self.training_mask().map(|mask| (&self.camera, mask))
    }

    /// Whether pixel `(u, v)` shows the object by the mask as given; nothing does without a mask.
    pub fn is_object(&self, u: u32, v: u32) -> bool {
        self.mask.as_ref().is_some_and(|mask| mask.is_object(u, v))
    }

    /// Whether pixel `(u, v)` shows the object by the mask that training uses; nothing does without a mask.
    pub fn is_training_object(&self, u: u32, v: u32) -> bool {
        self.training_mask().is_some_and(|mask| mask.is_object(u, v))
    }
}

/// Checks that every view has a mask.
///
/// # Errors
/// [`Error::MasksMissing`] naming the views that have none.
pub fn require_masks<'a>(views: impl IntoIterator<Item = &'a View>) -> Result<()> {
    let without = views.into_iter().filter(|view| view.mask.is_none());
    let views: Vec<String> = without.map(|view| view.name.clone()).collect();
    if views.is_empty() { Ok(()) } else { Err(Error::MasksMissing { views }) }
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
    /// For each point the views that see it, as ascending indices into [`Scene::views`]; empty lists where the files do not
    /// say.
    pub visible_in: Vec<Vec<usize>>,
    /// For each point, in the order of `visible_in`, where the views' pictures show it, as `(x / z, y / z)` in camera
    /// space; `None` where the files do not say.
    pub bearings: Option<Vec<Vec<DVec2>>>,
    /// For each point its reprojection error, in pixels of the files' pictures; `None` where the files do not say.
    pub errors_px: Option<Vec<f64>>,
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
    /// Where in the unit cube the object is, and what decided it.
    pub region: Region,
    /// Points on the object that come with the cameras: COLMAP's model, nerfstudio's PLY, or `pcl.npz` of the DVR files.
    pub sparse_points: Option<SparsePoints>,
    /// The true shape, where the dataset has it.
    pub ground_truth: GroundTruth,
    /// What a user should know before training, in plain words.
    pub warnings: Vec<String>,
}

impl SparsePoints {
    /// Whether it is known of any point which views see it.
    pub fn has_tracks(&self) -> bool {
        self.visible_in.iter().any(|views| !views.is_empty())
    }
}

impl Scene {
    /// The views of one split, in order.
    pub fn views_of(&self, split: Split) -> impl Iterator<Item = &View> {
        self.views.iter().filter(move |view| view.split == split)
    }

    /// Checks that every view has a mask: for methods that cannot do without.
    ///
    /// # Errors
    /// [`Error::MasksMissing`] naming the views that have none.
    pub fn require_masks(&self) -> Result<()> {
        require_masks(&self.views)
    }

    /// The direction that is up in most of the pictures, in object space; +y where they disagree.
    pub fn up(&self) -> DVec3 {
        let sum: DVec3 = self.views.iter().map(|view| -view.camera.rotation.row(1)).sum();
        if sum.length() > 0.2 * self.views.len() as f64 { sum.normalize() } else { DVec3::Y }
    }
}
