//! A sparse model as its three files hold it.

use std::collections::HashMap;

/// A sparse model as its three files hold it.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Model {
    pub(super) cameras: HashMap<u32, ModelCamera>,
    pub(super) images: Vec<ModelImage>,
    pub(super) points: Vec<ModelPoint>,
}

#[derive(Debug, PartialEq)]
pub(super) struct ModelCamera {
    pub(super) model: String,
    pub(super) width: u64,
    pub(super) height: u64,
    pub(super) parameters: Vec<f64>,
}

#[derive(Debug, PartialEq)]
pub(super) struct ModelImage {
    pub(super) id: u32,
    /// `w x y z`, world to camera.
    pub(super) rotation: [f64; 4],
    pub(super) translation: [f64; 3],
    pub(super) camera: u32,
    pub(super) name: String,
    /// Where features are, in pixels.
    pub(super) features: Vec<[f32; 2]>,
}

#[derive(Debug, PartialEq)]
pub(super) struct ModelPoint {
    pub(super) position: [f64; 3],
    pub(super) color: [u8; 3],
    /// Mean reprojection error in pixels.
    pub(super) error: f64,
    pub(super) track: Vec<TrackEntry>,
}

/// Where an image shows a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TrackEntry {
    /// Id of the image.
    pub(super) image: u32,
    /// Index of its feature.
    pub(super) feature: u32,
}
