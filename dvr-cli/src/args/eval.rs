//! `dvr eval`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dvr_core::Split;
use dvr_train::Shard;

use super::device::BackendArg;
use super::mesh::MeshingArgs;
use super::scene::SceneArgs;
use super::symmetry::SymmetryArg;
use super::train::ObjectsArgs;
use super::values::{parse_length, parse_shard, within};

/// Arguments of `dvr eval`.
#[derive(Args, Debug)]
pub struct EvalArgs {
    /// Folder of a run, one of its checkpoints, or a mesh file in the scene's coordinates
    #[arg(required_unless_present_any = ["baseline", "merge"], conflicts_with_all = ["baseline", "merge"])]
    pub subject: Option<PathBuf>,
    /// Scene with ground truth or test views, or dataset of objects [default: the run's own]
    #[arg(long, value_name = "PATH")]
    pub data: Option<PathBuf>,
    /// Also write the figures of a scene to this file, as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Replace the file of --json
    #[arg(long)]
    pub overwrite: bool,
    /// Seed of the surface samples and of the choice of each object's input picture
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// Samples across the object cube when views of the field are rendered [2 to 8192]
    #[arg(long, default_value_t = 128, value_parser = within(2u32, 8192), value_name = "N")]
    pub samples: u32,
    /// Skip rendering the test views
    #[arg(long)]
    pub no_views: bool,
    /// Match the photographs once more, as the run did before training, and measure the depth maps
    #[arg(long)]
    pub depth_maps: bool,
    #[command(flatten)]
    pub points: EvalPointsArgs,
    #[command(flatten)]
    pub protocol: EvalProtocolArgs,
    #[command(flatten)]
    pub objects: EvalObjectsArgs,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub backend: BackendArg,
    #[command(flatten)]
    pub reading: SceneArgs,
}

/// How a mesh is measured by points that are known to lie on the surface.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Verified points")]
pub struct EvalPointsArgs {
    /// Points on the true surface, in the coordinates of the scene's files: NPZ (`points`, with `views` and `error_px` if
    /// known), PLY, or COLMAP's points3D.{bin,txt}; a mesh needs no --data then [default: those of the scene]
    #[arg(long, value_name = "FILE")]
    pub points: Option<PathBuf>,
    /// Count points that are nearer than this, in the units of the files; several with commas
    /// [above 0 to 1e12; default: five round numbers that fit the cloud]
    #[arg(long, value_name = "LENGTH", value_delimiter = ',', value_parser = parse_length)]
    pub thresholds: Vec<f64>,
    /// How far the mesh may stand in front of a point before it hides it, in the units of the files
    /// [above 0 to 1e12; default: a round number, at most 0.5 % of the cloud]
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    pub margin: Option<f64>,
}

/// How a surface is measured by a data set's own protocol.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Protocols of data sets")]
pub struct EvalProtocolArgs {
    /// Measure by the protocol of a data set, in millimetres and the data set's coordinates; a mesh, or a PLY of points
    /// alone, needs no --data then
    #[arg(long, value_enum, value_name = "NAME", requires = "reference")]
    pub protocol: Option<Protocol>,
    /// Folder of the data set's evaluation data: for DTU the one that holds ObsMask and Points
    #[arg(long, value_name = "DIR", requires = "protocol")]
    pub reference: Option<PathBuf>,
    /// Which scan it is [0 to 999999; default: the only one of --reference, else the number behind `scan` in the path of
    /// the scene or the mesh]
    #[arg(long, value_name = "N", requires = "protocol", value_parser = within(0u32, 999_999))]
    pub scan: Option<u32>,
    /// First leave out what lies more than this many pixels outside the mask of a view [0 to 10000; default: nothing is
    /// left out]
    #[arg(long, value_name = "PIXELS", requires = "protocol", value_parser = within(0.0f64, 10_000.0))]
    pub cull: Option<f64>,
    /// First move, turn and scale the surface to the scan (ICP), for cameras that are not the data set's
    #[arg(long, requires = "protocol")]
    pub align: bool,
}

/// Protocols of data sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Protocol {
    /// DTU multi-view stereo (Aanæs et al. 2016): observation mask, plane, points 0.2 mm apart, distances below 20 mm
    Dtu,
}

/// How a model is evaluated on a dataset of objects.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Datasets of objects")]
pub struct EvalObjectsArgs {
    /// Split to evaluate [default: test]
    #[arg(long, value_enum, value_name = "SPLIT")]
    pub split: Option<SplitArg>,
    /// Folder for objects.jsonl and the tables summary.{json,csv,md}; objects in objects.jsonl are not measured again
    /// [default: eval_SPLIT in the run; with --threshold and --symmetry eval_SPLIT_at_OCCUPANCY_symmetry_on]
    #[arg(long, short, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Evaluate one part of the objects, for a cluster's job array: 3/16 is the third of sixteen parts
    /// [1 to 1000000 parts]
    #[arg(long, value_parser = parse_shard, value_name = "I/N")]
    pub shard: Option<Shard>,
    /// Also compare renders of each mesh with this many views of the object [0 to 100000]
    #[arg(long, default_value_t = 0, value_parser = within(0usize, 100_000), value_name = "N")]
    pub object_views: usize,
    /// Also write the shape of each object, as CATEGORY/NAME.ply in the folder `shapes` beside the tables
    #[arg(long, conflicts_with = "merge")]
    pub keep_shapes: bool,
    /// Occupancy at which the surface lies: lower takes in what is less certain, as thin parts are; where nothing
    /// comes to it, the likeliest points make the surface [0.001 to 0.999; default: that of
    /// the training]
    #[arg(long, value_parser = within(0.001f64, 0.999), value_name = "OCCUPANCY", conflicts_with_all = ["baseline", "merge"])]
    pub threshold: Option<f64>,
    /// Whether objects are taken for their own mirror images [default: as the training found, which config.json says]
    #[arg(long, value_enum, value_name = "WHETHER", conflicts_with_all = ["baseline", "merge"])]
    pub symmetry: Option<SymmetryArg>,
    /// Evaluate a baseline instead of a run
    #[arg(long, value_enum, requires = "data", requires = "out")]
    pub baseline: Option<Baseline>,
    #[command(flatten)]
    pub reading: ObjectsArgs,
    /// Merge results (objects*.jsonl): the parts of one run become one table, several runs one row each
    #[arg(long, num_args = 1.., value_name = "FILE", requires = "out", conflicts_with_all = ["baseline", "data"])]
    pub merge: Vec<PathBuf>,
}

/// The splits of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SplitArg {
    /// Objects that were trained on
    Train,
    /// Objects that the best checkpoint was chosen by
    Val,
    /// Objects that training never uses
    Test,
}

impl SplitArg {
    /// The library's split.
    pub fn split(self) -> Split {
        match self {
            Self::Train => Split::Train,
            Self::Val => Split::Val,
            Self::Test => Split::Test,
        }
    }
}

/// Baselines for models of many objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Baseline {
    /// The mean training shape of the object's category, independent of the picture
    MeanShape,
    /// The training object with the most similar picture
    NearestPicture,
}
