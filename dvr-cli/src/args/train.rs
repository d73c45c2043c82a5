//! `dvr train`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use dvr_core::dataset::ObjectOptions;
use dvr_train::Supervision;

use super::values::{parse_bytes, parse_capacity, parse_duration};
use super::{BackendArg, MeshingArgs, SceneArgs};
use crate::backend::Backend;

/// Arguments of `dvr train`.
#[derive(Args, Debug)]
pub struct TrainArgs {
    /// Folder (or cameras file) of a scene, which is reconstructed; or folder of a dataset of many objects, from which
    /// a model learns to make shapes of single pictures. Not needed with --resume
    #[arg(required_unless_present_any = ["resume", "print_config"])]
    pub scene: Option<PathBuf>,
    /// Folder for checkpoints, mesh, preview and figures
    #[arg(long, short, value_name = "DIR", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    /// Continue the run in --out from its last checkpoint
    #[arg(long, conflicts_with_all = ["overwrite", "config", "set", "supervision", "steps", "seed", "method", "refine_cameras", "capacity", "max_bytes", "categories", "inputs", "pretrained"])]
    pub resume: bool,
    /// Replace the run in --out
    #[arg(long)]
    pub overwrite: bool,
    /// What teaches the shape: rgb, depth or rgb+depth; for datasets also occupancy (3D, from points.npz) [default:
    /// rgb]
    #[arg(long, value_name = "WHAT", help_heading = "Training")]
    pub supervision: Option<Supervision>,
    /// How to reconstruct [default: fast; for datasets: network]
    #[arg(long, visible_alias = "preset", value_enum, help_heading = "Training")]
    pub method: Option<MethodName>,
    /// How fine the field of `fast` may become: auto, or cells along an edge (a power of two, 32 to 512) [default:
    /// auto]
    #[arg(long, value_parser = parse_capacity, value_name = "CELLS", help_heading = "Training")]
    pub capacity: Option<CapacityArg>,
    /// The stored field of `fast` may not take more than this, e.g. 32k or 1M
    #[arg(long, value_parser = parse_bytes, value_name = "BYTES", help_heading = "Training")]
    pub max_bytes: Option<usize>,
    /// Cameras may be slightly wrong (a degree, some per cent): move them to where they fit together before training,
    /// in at most so many rounds of one or two seconds. The refined cameras are used from then on, and written to
    /// cameras.json
    #[arg(long, value_name = "ROUNDS", num_args = 0..=1, default_missing_value = "10", help_heading = "Training")]
    pub refine_cameras: Option<usize>,
    /// Optimiser steps; with `fast`, of each stage [default: see --print-config]
    #[arg(long, value_name = "N", help_heading = "Training")]
    pub steps: Option<usize>,
    /// Stop training after this time, e.g. 90s, 10m, 2h
    #[arg(long, value_parser = parse_duration, value_name = "TIME", help_heading = "Training")]
    pub time: Option<Duration>,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "N", help_heading = "Training")]
    pub seed: Option<u64>,
    /// JSON file with configuration values that replace the defaults, or a YAML configuration of the original PyTorch
    /// code
    #[arg(long, value_name = "FILE", help_heading = "Training")]
    pub config: Option<PathBuf>,
    /// One configuration value, e.g. --set losses.smoothness=1; may be given several times
    #[arg(long, value_name = "KEY=VALUE", help_heading = "Training")]
    pub set: Vec<String>,
    /// Print the configuration as JSON and stop
    #[arg(long, help_heading = "Training")]
    pub print_config: bool,
    /// Compare the shape with the truth, where the scene has it, at each validation: the column chamfer_l1 of
    /// metrics.csv. The clock stands still meanwhile
    #[arg(long, help_heading = "Training")]
    pub follow_shape: bool,
    /// Write no report.html
    #[arg(long)]
    pub no_report: bool,
    #[command(flatten)]
    pub objects: ObjectsArgs,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub backend: BackendArg,
    /// Share each step of a network with these too, e.g. --backend gpu:0 --also-on gpu:1,gpu:2. Each takes as many rays,
    /// or of a dataset as many objects
    #[arg(long, value_name = "BACKEND", value_delimiter = ',')]
    pub also_on: Vec<Backend>,
    #[command(flatten)]
    pub reading: SceneArgs,
}

/// How a dataset of objects is read.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Datasets of objects")]
pub struct ObjectsArgs {
    /// Only these categories, by folder or by name; separate with commas
    #[arg(long, value_delimiter = ',', value_name = "CATEGORY")]
    pub categories: Vec<String>,
    /// Dataset with the encoder's pictures, under the same category and object, e.g. the 3D-R2N2 renders [default: the
    /// objects' own]
    #[arg(long, value_name = "DIR")]
    pub inputs: Option<PathBuf>,
    /// Start the encoder from a trained ResNet-18: torchvision's .pth, or a checkpoint of the original
    #[arg(long, value_name = "FILE")]
    pub pretrained: Option<PathBuf>,
}

impl ObjectsArgs {
    /// As the library takes it; depth comes from where the scene's arguments say.
    pub fn options(&self, reading: &SceneArgs) -> ObjectOptions {
        ObjectOptions {
            categories: self.categories.clone(),
            inputs: self.inputs.clone(),
            visual_hull_depth: reading.visual_hull_depth,
        }
    }
}

/// How a scene is reconstructed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// A compact field on grids: seconds
    Fast,
    /// The publication's network, started from the visual hull: minutes; for datasets, of a size for a few cores: an
    /// hour
    Network,
    /// The network with the publication's own settings: minutes for 600 steps (the publication: 300 000); for datasets:
    /// months without a GPU
    Classic,
    /// The visual hull of the masks, coloured by the photographs: what can be had without any training
    Hull,
}

/// What `--capacity` says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CapacityArg {
    /// As fine as held-out views ask for.
    Auto,
    /// So many cells along an edge.
    Cells(usize),
}
