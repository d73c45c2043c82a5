//! `dvr train`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use dvr_core::dataset::ObjectOptions;
use dvr_train::Supervision;

use super::cameras::FindingArgs;
use super::device::BackendArg;
use super::known_length::KnownLengthArg;
use super::masks::SegmentArg;
use super::mesh::MeshingArgs;
use super::method::{CapacityArg, MethodName, parse_capacity};
use super::preset::PresetArg;
use super::scene::SceneArgs;
use super::texture::TextureArg;
use super::values::{parse_bytes, parse_duration, within};
use crate::backend::Backend;

/// Arguments of `dvr train`.
#[derive(Args, Clone, Debug)]
pub struct TrainArgs {
    /// Folder or cameras file of a scene to reconstruct; folder of photographs without cameras, or a clip, whose cameras are found first; or
    /// folder of a dataset of objects, to train single-image reconstruction. Not needed with --resume
    #[arg(required_unless_present_any = ["resume", "print_config"])]
    pub scene: Option<PathBuf>,
    /// Further sets of photographs of the same object in other poses, turned over say, whose backgrounds differ: folders, clips or
    /// scenes as the first. They become one scene, and one mesh without an unseen side
    #[arg(value_name = "MORE", conflicts_with = "print_config")]
    pub more: Vec<PathBuf>,
    /// Folder of the run: checkpoints, mesh, preview sheet, metrics, report
    #[arg(long, short, value_name = "DIR", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    /// Resume the run in --out from its last checkpoint, with the options that it began with. Options that are given again
    /// must be the same, except for time, devices, mesh and report, and for more steps of networks
    #[arg(long, conflicts_with = "overwrite")]
    pub resume: bool,
    /// Replace the run in --out: its own files, and nothing else in the folder
    #[arg(long)]
    pub overwrite: bool,
    /// What supervises the shape: rgb, depth or rgb+depth; for datasets of objects also occupancy (3D, from points.npz)
    /// [default: rgb]
    #[arg(long, value_name = "WHAT", help_heading = "Training")]
    pub supervision: Option<Supervision>,
    /// Reconstruction method [default: grid; for datasets of objects: objects]
    #[arg(long, value_enum, help_heading = "Training")]
    pub method: Option<MethodName>,
    /// Finest grid of the method `grid`: auto (decided on validation views), or cells per edge, a power of two from 32 to
    /// 512 [default: auto]
    #[arg(long, value_parser = parse_capacity, value_name = "CELLS", help_heading = "Training")]
    pub capacity: Option<CapacityArg>,
    /// Largest size of the stored field of the method `grid`, e.g. 32k or 1M [1 to 1000G]
    #[arg(long, value_parser = parse_bytes, value_name = "BYTES", help_heading = "Training")]
    pub max_bytes: Option<usize>,
    /// Refine cameras that are slightly off (a degree, some per cent) before training, in at most ROUNDS rounds of one or
    /// two seconds each. Refined cameras are written to cameras.json [0 to 1000]
    #[arg(long, value_parser = within(0usize, 1000), value_name = "ROUNDS", num_args = 0..=1, default_missing_value = "10", help_heading = "Training")]
    pub refine_cameras: Option<usize>,
    /// Optimiser steps; with the method `grid`, per stage
    /// [0 to 1000000000; default: see --print-config]
    #[arg(long, value_parser = within(0usize, 1_000_000_000), value_name = "N", help_heading = "Training")]
    pub steps: Option<usize>,
    /// Time limit of training, e.g. 90s, 10m, 2h [0s to 8760h]
    #[arg(long, value_parser = parse_duration, value_name = "TIME", help_heading = "Training")]
    pub time: Option<Duration>,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "N", help_heading = "Training")]
    pub seed: Option<u64>,
    /// JSON file with configuration values that replace the defaults, or a YAML configuration of DVR's reference code
    #[arg(long, value_name = "FILE", help_heading = "Training")]
    pub config: Option<PathBuf>,
    /// Set a configuration value, e.g. --set losses.smoothness.weight=1; repeatable
    #[arg(long, value_name = "KEY=VALUE", help_heading = "Training")]
    pub set: Vec<String>,
    /// Print the configuration as JSON and exit
    #[arg(long, help_heading = "Training")]
    pub print_config: bool,
    /// Measure Chamfer-L1 against the scene's ground truth at each validation (column chamfer_l1 of metrics.csv). The clock
    /// stops meanwhile
    #[arg(long, help_heading = "Training")]
    pub follow_shape: bool,
    /// Do not write report.html
    #[arg(long)]
    pub no_report: bool,
    /// Folder for the cameras of photographs that have none [default: the name of their folder or of the clip with
    /// -cameras behind it]; of several sets, for the scene that they become [default: their names with -joined behind them],
    /// beside which those of each set lie
    #[arg(long, value_name = "DIR", help_heading = "Finding cameras (COLMAP)")]
    pub cameras: Option<PathBuf>,
    #[command(flatten)]
    pub finding: FindingArgs,
    #[command(flatten)]
    pub objects: ObjectsArgs,
    /// What makes the latent code of a picture: `convolutional-bn` (small, with batch normalisation), `convolutional` (that of DVR's
    /// reference code), `resnet18`; `local-bn` and `local`, with batch normalisation and without, whose features a decoder also looks up
    /// where a point lies in the picture (as PIFu); or `codes`, one for each training object, without pictures [default: that of the
    /// method]
    #[arg(long, value_name = "KIND", value_parser = ["convolutional-bn", "convolutional", "resnet18", "local-bn", "local", "codes"], help_heading = "Datasets of objects")]
    pub encoder: Option<String>,
    /// Initialise the encoder with a trained ResNet-18: torchvision's .pth, or a checkpoint of DVR's reference code
    #[arg(long, value_name = "FILE", help_heading = "Datasets of objects")]
    pub pretrained: Option<PathBuf>,
    /// Real size: two pixels of a photograph on the object, and how far apart their points are, e.g.
    /// "IMG_1.jpg:(120,340)-(510,352)=12cm" (m, cm, mm, in or ft; pixels of the file from (0,0) at the top left [0 to 1000000],
    /// lengths [0.000001 to 1000000]). Meshes are then in metres. Repeatable: the mean stands, and what disagrees is told
    #[arg(long, value_name = "LENGTH", help_heading = "Mesh")]
    pub scale: Vec<KnownLengthArg>,
    /// Where masks are found from all views: cut the mesh by the plane that the object was found to stand on, and close the cut by
    /// a flat cap
    #[arg(long, help_heading = "Mesh")]
    pub drop_support: bool,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub preset: PresetArg,
    #[command(flatten)]
    pub texture: TextureArg,
    #[command(flatten)]
    pub backend: BackendArg,
    /// Train a network data parallel on several devices, instead of --backend, e.g. gpu:0,gpu:1. Each step's rays, or
    /// objects of a dataset, are split evenly
    #[arg(long, value_name = "BACKEND", value_delimiter = ',', conflicts_with = "backend")]
    pub devices: Vec<Backend>,
    #[command(flatten)]
    pub segment: SegmentArg,
    #[command(flatten)]
    pub reading: SceneArgs,
}

/// How a dataset of objects is read.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Datasets of objects")]
pub struct ObjectsArgs {
    /// Only these categories, by folder or by name; comma-separated
    #[arg(long, value_delimiter = ',', value_name = "CATEGORY")]
    pub categories: Vec<String>,
    /// Dataset with the encoder's input pictures under the same categories and objects, e.g. the 3D-R2N2 renders [default:
    /// the views themselves]
    #[arg(long, value_name = "DIR")]
    pub inputs: Option<PathBuf>,
}

impl TrainArgs {
    /// Where to train; with several devices, the first of them.
    pub fn backend(&self) -> Backend {
        self.devices.first().copied().unwrap_or(self.backend.backend)
    }

    /// Further devices that share each step.
    pub fn more_devices(&self) -> &[Backend] {
        self.devices.get(1..).unwrap_or_default()
    }
}

impl ObjectsArgs {
    /// The library's options; the source of depth maps is an argument of scenes.
    pub fn options(&self, reading: &SceneArgs) -> ObjectOptions {
        ObjectOptions {
            inputs_are_views: false,
            categories: self.categories.clone(),
            inputs: self.inputs.clone(),
            visual_hull_depth: reading.visual_hull_depth,
        }
    }
}
