//! What can be chosen, and what is told on the way.

use std::path::PathBuf;
use std::str::FromStr;

use dvr_core::Cancellation;
use serde::{Deserialize, Serialize};

/// How cameras are found. The default suits photographs of one camera, phones included.
#[derive(Clone, Debug, Serialize)]
pub struct SfmOptions {
    /// COLMAP's camera model.
    pub camera_model: String,
    /// Which pictures share the intrinsics of a camera.
    pub sharing: CameraSharing,
    /// Which pictures are compared; `None` decides by their number and kind.
    pub matching: Option<Matching>,
    /// How pictures are placed.
    #[serde(skip_serializing_if = "Mapper::is_incremental")]
    pub mapper: Mapper,
    /// Largest number of features of a picture; the coarsest are kept. Comparing two pictures takes time by its square.
    pub features: usize,
    /// A vocabulary tree of COLMAP's, by which similar pictures are found and compared.
    pub vocabulary_tree: Option<PathBuf>,
    /// Frames that are taken from a clip.
    pub frames: usize,
    /// COLMAP's program; `None` looks for `colmap` in the folders of `PATH`.
    #[serde(skip)]
    pub program: Option<PathBuf>,
    /// Threads of COLMAP; `None` takes as many as the machine has.
    #[serde(skip)]
    pub threads: Option<usize>,
    /// Features and matches on a GPU, where COLMAP was built for one.
    pub gpu: bool,
    /// Replaces what the folder holds of other photographs or options.
    #[serde(skip)]
    pub may_replace: bool,
    /// Ends the work early; COLMAP is ended with it.
    #[serde(skip)]
    pub cancellation: Cancellation,
}

impl SfmOptions {
    /// Camera models that COLMAP fits, of those that all its versions have.
    pub const CAMERA_MODELS: [&'static str; 11] = [
        "SIMPLE_PINHOLE",
        "PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "OPENCV",
        "OPENCV_FISHEYE",
        "FULL_OPENCV",
        "FOV",
        "SIMPLE_RADIAL_FISHEYE",
        "RADIAL_FISHEYE",
        "THIN_PRISM_FISHEYE",
    ];
}

impl Default for SfmOptions {
    fn default() -> Self {
        Self {
            camera_model: "SIMPLE_RADIAL".to_owned(),
            sharing: CameraSharing::Similar,
            matching: None,
            mapper: Mapper::default(),
            features: 4096,
            vocabulary_tree: None,
            frames: 100,
            program: None,
            threads: None,
            gpu: false,
            may_replace: false,
            cancellation: Cancellation::default(),
        }
    }
}

/// Which pictures share the intrinsics of a camera: focal length, principal point and distortion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CameraSharing {
    /// Those of one size, and of one camera and focal length by their EXIF data.
    #[default]
    Similar,
    /// Those of one folder and size.
    Folder,
    /// None: a camera per picture, for a zoom or a focus that changes.
    Picture,
}

impl FromStr for CameraSharing {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "similar" => Ok(Self::Similar),
            "folder" => Ok(Self::Folder),
            "picture" => Ok(Self::Picture),
            _ => Err("expected similar, folder or picture".to_owned()),
        }
    }
}

/// Which pictures are compared with which.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Matching {
    /// Each with each.
    Exhaustive,
    /// Each with those beside it in the order of their names, and some of them with each other, which closes loops.
    Sequential,
    /// Each with those that were taken near it, by the GPS data of their EXIF.
    Spatial,
}

impl FromStr for Matching {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "exhaustive" => Ok(Self::Exhaustive),
            "sequential" => Ok(Self::Sequential),
            "spatial" => Ok(Self::Spatial),
            _ => Err("expected exhaustive, sequential or spatial".to_owned()),
        }
    }
}

/// How pictures are placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mapper {
    /// One after another.
    #[default]
    Incremental,
    /// All at once (GLOMAP; Pan et al., ECCV 2024), by a COLMAP that can, else by `glomap`.
    Global,
}

impl Mapper {
    /// What is not the default alone stands in the description of found cameras, so that older ones are still known.
    fn is_incremental(&self) -> bool {
        *self == Self::Incremental
    }
}

impl FromStr for Mapper {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "incremental" => Ok(Self::Incremental),
            "global" => Ok(Self::Global),
            _ => Err("expected incremental or global".to_owned()),
        }
    }
}

/// What is told while cameras are found.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A step begins.
    Step {
        /// What it does.
        name: &'static str,
        /// Of how many parts it is made; 1 where that is not known.
        parts: usize,
    },
    /// As many parts of the step are done. It may go back: COLMAP begins a new model where one has come to its end.
    Progress(usize),
    /// Something that the user should know, a sentence without its full stop.
    Note(String),
}
