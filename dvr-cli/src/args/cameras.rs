//! `dvr cameras`, and how cameras are found.

use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;
use dvr_sfm::{CameraSharing, Mapper, Matching, SfmOptions};

use super::values::within;

/// Arguments of `dvr cameras`.
#[derive(Args, Debug)]
pub struct CamerasArgs {
    /// Folder of photographs, or a clip
    pub photographs: PathBuf,
    /// Further folders of photographs, clips or scenes of the same object in other poses, whose backgrounds differ: all become
    /// one scene, with masks. For more of how they are read, `dvr train` has options
    #[arg(value_name = "MORE")]
    pub more: Vec<PathBuf>,
    /// Folder for cameras and undistorted pictures [default: the name of the folder or clip with -cameras behind it; of several
    /// sets all their names with -joined]
    #[arg(long, short, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace cameras that the folder has of other photographs, or by other options
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    pub finding: FindingArgs,
}

/// How cameras are found.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Finding cameras (COLMAP)")]
pub struct FindingArgs {
    /// Frames to take from a clip: the sharpest of as many equal stretches of its time [3 to 10000; default: 100]
    #[arg(long, value_name = "N", value_parser = within(3usize, 10_000))]
    pub frames: Option<usize>,
    /// Camera model to fit [default: SIMPLE_RADIAL]
    #[arg(long, value_name = "MODEL", value_parser = PossibleValuesParser::new(SfmOptions::CAMERA_MODELS), ignore_case = true)]
    pub camera_model: Option<String>,
    /// Which pictures share intrinsics: similar (same size, camera and focal length by EXIF), folder, or picture (none,
    /// for a zoom) [default: similar]
    #[arg(long, value_name = "WHICH")]
    pub share_cameras: Option<CameraSharing>,
    /// Which pictures are compared: exhaustive, sequential (in the order of their names) or spatial (by GPS) [default:
    /// exhaustive up to 300 pictures, else sequential]
    #[arg(long, value_name = "HOW")]
    pub matching: Option<Matching>,
    /// How pictures are placed: incremental (one after another) or global (all at once, for hundreds of pictures, by COLMAP 4 or GLOMAP)
    /// [default: incremental]
    #[arg(long, value_name = "HOW")]
    pub mapper: Option<Mapper>,
    /// Features of a picture, at most; matching takes time by their square [100 to 65536; default: 4096]
    #[arg(long, value_name = "N", value_parser = within(100usize, 65_536))]
    pub features: Option<usize>,
    /// Compare pictures that a vocabulary tree of COLMAP's finds similar
    #[arg(long, value_name = "FILE", conflicts_with = "matching")]
    pub vocab_tree: Option<PathBuf>,
    /// COLMAP's program [default: `colmap` in the folders of PATH]
    #[arg(long, value_name = "PROGRAM")]
    pub colmap: Option<PathBuf>,
    /// Threads of COLMAP [1 to 1024; default: all]
    #[arg(long, value_name = "N", value_parser = within(1usize, 1024))]
    pub colmap_threads: Option<usize>,
    /// Features and matches on a GPU, for a COLMAP that was built with CUDA
    #[arg(long)]
    pub colmap_gpu: bool,
}

impl FindingArgs {
    /// The library's options.
    pub fn options(&self) -> SfmOptions {
        let defaults = SfmOptions::default();
        SfmOptions {
            camera_model: self.camera_model.as_ref().map_or(defaults.camera_model, |model| model.to_uppercase()),
            sharing: self.share_cameras.unwrap_or_default(),
            matching: self.matching,
            mapper: self.mapper.unwrap_or_default(),
            frames: self.frames.unwrap_or(defaults.frames),
            features: self.features.unwrap_or(defaults.features),
            vocabulary_tree: self.vocab_tree.clone(),
            program: self.colmap.clone(),
            threads: self.colmap_threads,
            gpu: self.colmap_gpu,
            ..SfmOptions::default()
        }
    }
}
