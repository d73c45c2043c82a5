//! The command line.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use clap::{Args, Parser, Subcommand, ValueEnum};
use dvr_core::Split;
use dvr_core::dataset::{Background, BackgroundColor, Format, Normalise, ObjectOptions, ReadOptions};
use dvr_train::{Shard, Supervision};

use crate::backend::Backend;

/// Posed photos in, a trustworthy textured mesh out.
#[derive(Debug, Parser)]
#[command(name = "dvr", version, about, long_about = LONG_ABOUT)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const LONG_ABOUT: &str = "Posed photos in, a trustworthy textured mesh out.

dvr reconstructs one object from photographs with known cameras and masks, by differentiable volumetric rendering: a \
neural occupancy and texture field whose surface depth has an exact, analytic gradient. Look at a scene with `dvr info` \
first, then `dvr train SCENE --out RUN` does the whole job: training, mesh (PLY and GLB), preview sheet and figures.";

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what was found in a scene: views, cameras, masks, bounds, and what may go wrong
    Info(InfoArgs),
    /// Reconstruct a scene: trains, then writes mesh, preview sheet and figures
    Train(TrainArgs),
    /// Extract the mesh of a run again, at another resolution or in another format
    Mesh(MeshArgs),
    /// Render a run: the dataset's views, or an orbit as images and a turntable animation
    Render(RenderArgs),
    /// Measure a run or a mesh: shape against ground truth, pictures against held-out views
    Eval(EvalArgs),
    /// Compare methods, or variants of one, on scenes: quality, time, memory and bytes with their spread over seeds
    Bench(BenchArgs),
    /// Render meshes into a ShapeNet-style dataset with images, masks, depth, cameras and ground truth
    Synth(SynthArgs),
    /// Write the network of a run as safetensors, with PyTorch names and layout
    Export(ExportArgs),
    /// Make a run of a checkpoint of the original PyTorch code (.pt)
    Import(ImportArgs),
    /// Make a mesh of the object in a single picture, with a run that has learned many objects
    Predict(PredictArgs),
}

/// How a scene is read.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Reading the scene")]
pub struct SceneArgs {
    /// Layout of the files: dvr, transforms (NeRF, nerfstudio), idr (IDR, NeuS), middlebury or colmap [default: found by looking]
    #[arg(long)]
    pub format: Option<Format>,
    /// Average this many by this many pixels into one
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64), value_name = "N")]
    pub downscale: u32,
    /// Take as mask what differs from a plain background: white, black, or border (each picture's own edge colour)
    #[arg(long, value_name = "COLOR")]
    pub background: Option<BackgroundColor>,
    /// How much a pixel must differ from the plain background, of 255
    #[arg(long, default_value_t = 12, requires = "background", value_name = "LEVEL")]
    pub background_threshold: u8,
    /// Use at most this many training views, spread evenly
    #[arg(long, value_name = "N")]
    pub views: Option<usize>,
    /// Leave out views, by name or by number from 0; separate with commas
    #[arg(long, value_delimiter = ',', value_name = "VIEW")]
    pub ignore: Vec<String>,
    /// Who says where the object is: auto, files (trust scale_mat) or hull (from the masks)
    #[arg(long, value_enum, default_value_t = NormaliseArg::Auto, value_name = "HOW")]
    pub normalise: NormaliseArg,
    /// DVR layout: take depth from visual_hull_depth/
    #[arg(long)]
    pub visual_hull_depth: bool,
    /// Decoded photographs above this, e.g. 500M or 2G, are kept in a scratch file instead of memory; the system pages them
    /// in as they are read. The file lies in the temporary folder (set TMPDIR to a folder on a disk with room: 4 bytes a
    /// pixel) and goes away by itself; results are the same [default: all in memory]
    #[arg(long, value_parser = parse_memory, value_name = "BYTES")]
    pub memory: Option<u64>,
}

/// Who says where the object is.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum NormaliseArg {
    /// The files where they promise the unit cube, else the masks
    Auto,
    /// The files
    Files,
    /// The masks
    Hull,
}

impl SceneArgs {
    /// As the library takes it.
    pub fn read_options(&self) -> ReadOptions {
        ReadOptions {
            format: self.format,
            downscale: self.downscale,
            background: self.background.map(|color| Background { color, threshold: self.background_threshold }),
            n_views: self.views,
            ignored_views: self.ignore.clone(),
            normalise: match self.normalise {
                NormaliseArg::Auto => Normalise::Auto,
                NormaliseArg::Files => Normalise::Files,
                NormaliseArg::Hull => Normalise::Hull,
            },
            visual_hull_depth: self.visual_hull_depth,
            max_memory: self.memory,
        }
    }
}

/// Where the computation runs.
#[derive(Args, Clone, Copy, Debug)]
pub struct BackendArg {
    /// Where to compute
    #[arg(long, value_enum, default_value_t = Backend::Cpu)]
    pub backend: Backend,
}

/// Arguments of `dvr info`.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// Folder (or cameras file) of the scene
    pub scene: PathBuf,
    #[command(flatten)]
    pub reading: SceneArgs,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `dvr train`.
#[derive(Args, Debug)]
pub struct TrainArgs {
    /// Folder (or cameras file) of a scene, which is reconstructed; or folder of a dataset of many objects, from which a model
    /// learns to make shapes of single pictures. Not needed with --resume
    #[arg(required_unless_present_any = ["resume", "print_config"])]
    pub scene: Option<PathBuf>,
    /// Folder for checkpoints, mesh, preview and figures
    #[arg(long, short, value_name = "DIR", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    /// Continue the run in --out from its last checkpoint
    #[arg(long, conflicts_with_all = ["overwrite", "config", "set", "supervision", "steps", "seed", "method", "capacity", "max_bytes", "categories", "inputs", "pretrained"])]
    pub resume: bool,
    /// Replace the run in --out
    #[arg(long)]
    pub overwrite: bool,
    /// What teaches the shape: rgb, depth or rgb+depth; for datasets also occupancy (3D, from points.npz) [default: rgb]
    #[arg(long, value_name = "WHAT", help_heading = "Training")]
    pub supervision: Option<Supervision>,
    /// How to reconstruct [default: fast; for datasets: network]
    #[arg(long, visible_alias = "preset", value_enum, help_heading = "Training")]
    pub method: Option<MethodName>,
    /// How fine the field of `fast` may become: auto, or cells along an edge (a power of two, 32 to 512) [default: auto]
    #[arg(long, value_parser = parse_capacity, value_name = "CELLS", help_heading = "Training")]
    pub capacity: Option<CapacityArg>,
    /// The stored field of `fast` may not take more than this, e.g. 32k or 1M
    #[arg(long, value_parser = parse_bytes, value_name = "BYTES", help_heading = "Training")]
    pub max_bytes: Option<usize>,
    /// Optimiser steps; with `fast`, of each stage [default: see --print-config]
    #[arg(long, value_name = "N", help_heading = "Training")]
    pub steps: Option<usize>,
    /// Stop training after this time, e.g. 90s, 10m, 2h
    #[arg(long, value_parser = parse_duration, value_name = "TIME", help_heading = "Training")]
    pub time: Option<Duration>,
    /// Seed of all random choices [default: 0]
    #[arg(long, value_name = "N", help_heading = "Training")]
    pub seed: Option<u64>,
    /// JSON file with configuration values that replace the defaults, or a YAML configuration of the original PyTorch code
    #[arg(long, value_name = "FILE", help_heading = "Training")]
    pub config: Option<PathBuf>,
    /// One configuration value, e.g. --set losses.roughness=1; may be given several times
    #[arg(long, value_name = "KEY=VALUE", help_heading = "Training")]
    pub set: Vec<String>,
    /// Print the configuration as JSON and stop
    #[arg(long, help_heading = "Training")]
    pub print_config: bool,
    #[command(flatten)]
    pub objects: ObjectsArgs,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub backend: BackendArg,
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
    /// Dataset with the encoder's pictures, under the same category and object, e.g. the 3D-R2N2 renders [default: the objects' own]
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
    /// A compact field on lattices: seconds
    Fast,
    /// The publication's network, started from the visual hull: minutes; for datasets, of a size for a few cores: an hour
    Network,
    /// The network with the publication's own settings: minutes for 600 steps (the publication: 300 000); for datasets: months without
    /// a GPU
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

/// Where a mesh has its colours from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Colors {
    /// The photographs that see the vertex: sharp
    Photos,
    /// The texture field: smooth, without traces of single pictures
    Field,
}

/// How the surface is made triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ContourName {
    /// Marching cubes: smooth, corners and creases are cut off by up to a cell
    MarchingCubes,
    /// Dual contouring: keeps corners and creases of the field; may intersect itself at thin or noisy parts
    Dual,
}

/// How a surface is extracted.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct SurfaceArgs {
    /// Grid cells along an edge of the object's cube [default: 256; 128 for objects of a dataset]
    #[arg(long, value_parser = clap::value_parser!(u32).range(8..=2048), value_name = "N")]
    pub resolution: Option<u32>,
    /// How the surface is made triangles; the mesh is watertight either way
    #[arg(long, value_enum, default_value_t = ContourName::MarchingCubes)]
    pub contour: ContourName,
    /// Drop pieces smaller than this share of the largest piece's area; 0 keeps everything
    #[arg(long, default_value_t = 0.01, value_name = "SHARE")]
    pub min_piece: f64,
    /// Save triangles where that moves the surface by no more than this share of the object's cube, e.g. 0.0005
    #[arg(long, default_value_t = 0.0, value_parser = parse_share, value_name = "SHARE")]
    pub simplify: f32,
}

/// How a coloured mesh is made.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Mesh")]
pub struct MeshingArgs {
    #[command(flatten)]
    pub surface: SurfaceArgs,
    /// Where vertex colours come from
    #[arg(long, value_enum, default_value_t = Colors::Photos)]
    pub colors: Colors,
}

/// Arguments of `dvr mesh`.
#[derive(Args, Debug)]
pub struct MeshArgs {
    /// Folder of a run, or one of its checkpoints
    pub run: PathBuf,
    /// File to write: .ply, .obj or .glb by its ending [default: mesh.ply and mesh.glb in the run]
    #[arg(long, short, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// For runs that know objects by learned codes: which one, counted from 0
    #[arg(long, value_name = "N")]
    pub object: Option<usize>,
    /// Leave the mesh in object space (the unit cube) instead of the scene's own coordinates
    #[arg(long)]
    pub object_space: bool,
    /// Where the scene lies now, if it was moved since training
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub backend: BackendArg,
}

/// Which cameras `dvr render` takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Cameras {
    /// A turn around the object
    Orbit,
    /// The views of the scene that the run was trained on
    Dataset,
}

/// Arguments of `dvr render`.
#[derive(Args, Debug)]
pub struct RenderArgs {
    /// Folder of a run, or one of its checkpoints
    pub run: PathBuf,
    /// Folder for the images
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// For runs that know objects by learned codes: which one, counted from 0
    #[arg(long, value_name = "N")]
    pub object: Option<usize>,
    /// Which cameras
    #[arg(long, value_enum, default_value_t = Cameras::Orbit)]
    pub cameras: Cameras,
    /// Frames of the orbit
    #[arg(long, default_value_t = 36, value_parser = clap::value_parser!(u32).range(1..=3600), value_name = "N")]
    pub frames: u32,
    /// Width and height of the orbit's frames, pixels
    #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..=8192), value_name = "PIXELS")]
    pub size: u32,
    /// Height of the orbit's camera above the object's middle, degrees
    #[arg(long, default_value_t = 20.0, allow_negative_numbers = true, value_name = "DEGREES")]
    pub elevation: f64,
    /// Axis the orbit turns around, in object space [default: the mean up direction of the scene's cameras]
    #[arg(long, value_enum)]
    pub up: Option<UpAxis>,
    /// Animation of the orbit
    #[arg(long, value_enum, default_value_t = Animation::Gif)]
    pub animation: Animation,
    /// Also write colour and z-depth as EXR (depth in the scene's units)
    #[arg(long)]
    pub exr: bool,
    /// Also write normals as PNG
    #[arg(long)]
    pub normals: bool,
    /// Samples across the object's cube
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(2..=8192), value_name = "N")]
    pub samples: u32,
    /// Where the scene lies now, if it was moved since training
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub backend: BackendArg,
}

/// An axis to turn around.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum UpAxis {
    /// +x
    X,
    /// +y
    Y,
    /// +z
    Z,
    /// -x
    MinusX,
    /// -y
    MinusY,
    /// -z
    MinusZ,
}

/// Format of the turntable.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Animation {
    /// turntable.gif
    Gif,
    /// Frames only
    None,
}

/// Arguments of `dvr eval`.
#[derive(Args, Debug)]
pub struct EvalArgs {
    /// Folder of a run, one of its checkpoints, or a mesh file in the scene's coordinates
    #[arg(required_unless_present_any = ["baseline", "merge"], conflicts_with_all = ["baseline", "merge"])]
    pub subject: Option<PathBuf>,
    /// The scene with ground truth or held-out views, or the dataset [default: what the run was trained on]
    #[arg(long, value_name = "PATH")]
    pub data: Option<PathBuf>,
    /// Write the figures of a scene to this file as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Seed of the surface samples, and of which picture an object is given by
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// Samples across the object's cube when views are rendered
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(2..=8192), value_name = "N")]
    pub samples: u32,
    /// Skip rendering the held-out views
    #[arg(long)]
    pub no_views: bool,
    #[command(flatten)]
    pub objects: EvalObjectsArgs,
    #[command(flatten)]
    pub meshing: MeshingArgs,
    #[command(flatten)]
    pub backend: BackendArg,
    #[command(flatten)]
    pub reading: SceneArgs,
}

/// How a model is measured on a dataset of many objects.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Datasets of objects")]
pub struct EvalObjectsArgs {
    /// The objects to measure: train, val or test [default: test]
    #[arg(long, value_enum, value_name = "SPLIT")]
    pub split: Option<SplitArg>,
    /// Folder for objects.jsonl and the tables summary.{json,csv,md}; objects that are in it already are not measured again
    /// [default: eval_SPLIT in the run]
    #[arg(long, short, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// One part of the objects, for a cluster's job array: 3/16 is the third of sixteen
    #[arg(long, value_parser = parse_shard, value_name = "I/N")]
    pub shard: Option<Shard>,
    /// Also compare renders of each mesh with so many views of the object
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub object_views: usize,
    /// Measure a baseline instead of a run
    #[arg(long, value_enum, requires = "data", requires = "out")]
    pub baseline: Option<Baseline>,
    #[command(flatten)]
    pub reading: ObjectsArgs,
    /// Join results (objects*.jsonl): shards become one table, several subjects stand side by side
    #[arg(long, num_args = 1.., value_name = "FILE", requires = "out", conflicts_with_all = ["baseline", "data"])]
    pub merge: Vec<PathBuf>,
}

/// The splits of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SplitArg {
    /// Objects that were trained on
    Train,
    /// Objects that chose the best step
    Val,
    /// Objects that training never saw
    Test,
}

impl SplitArg {
    /// As the library has it.
    pub fn split(self) -> Split {
        match self {
            Self::Train => Split::Train,
            Self::Val => Split::Val,
            Self::Test => Split::Test,
        }
    }
}

/// What a model must beat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Baseline {
    /// The mean training shape of the object's category, whatever the picture shows
    MeanShape,
    /// The training object with the most similar picture
    NearestPicture,
}

/// Arguments of `dvr bench`.
#[derive(Args, Debug)]
pub struct BenchArgs {
    /// Folders (or cameras files) of the scenes
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Folder for results.json, results.csv, table.md and the runs; runs that are there already are not repeated
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Methods to compare, as `dvr train --method` takes them; separate with commas
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [MethodName::Hull, MethodName::Fast], value_name = "METHOD")]
    pub methods: Vec<MethodName>,
    /// A variant of `fast` with a name and other settings, e.g. no-cross-view:losses.cross_view=0,losses.structure=0; may be
    /// given several times
    #[arg(long, value_parser = parse_variant, value_name = "NAME:KEY=VALUE")]
    pub variant: Vec<Variant>,
    /// What teaches the shape: rgb, depth, rgb+depth; separate with commas
    #[arg(long, value_delimiter = ',', default_value = "rgb", value_name = "WHAT")]
    pub supervision: Vec<Supervision>,
    /// Seeds from 0 on
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=100), value_name = "N")]
    pub seeds: u64,
    /// Stop each training after this time, e.g. 10m
    #[arg(long, value_parser = parse_duration, value_name = "TIME")]
    pub time: Option<Duration>,
    /// Results from elsewhere, to stand in the same table: a results.json, or a list of {scene, method, seconds, chamfer_l1, ...}
    #[arg(long, value_name = "FILE")]
    pub overlay: Vec<PathBuf>,
}

impl BenchArgs {
    /// What is compared: the methods, then the variants.
    pub fn variants(&self) -> Vec<Variant> {
        let name = |method: &MethodName| method.to_possible_value().map(|value| value.get_name().to_owned());
        let methods = self.methods.iter().filter_map(name);
        let methods = methods.map(|name| Variant { method: name.clone(), name, settings: Vec::new() });
        methods.chain(self.variant.iter().cloned()).collect()
    }
}

/// A method with some of its settings changed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// What it is called in tables.
    pub name: String,
    /// The method.
    pub method: String,
    /// `KEY=VALUE`, as `--set` takes them.
    pub settings: Vec<String>,
}

/// Arguments of `dvr synth`.
#[derive(Args, Debug)]
pub struct SynthArgs {
    /// Meshes (OBJ, PLY, OFF, GLB, glTF), or folders of them: a folder's name becomes the category
    #[arg(required_unless_present = "print_config")]
    pub meshes: Vec<PathBuf>,
    /// Folder of the dataset
    #[arg(long, short, value_name = "DIR", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    /// Views of each object
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=10_000), value_name = "N")]
    pub views: u32,
    /// Width and height in pixels, e.g. 64 or 320x240
    #[arg(long, default_value = "64", value_parser = parse_size, value_name = "SIZE")]
    pub size: (u32, u32),
    /// Category of meshes that are given as files [default: the folder's name]
    #[arg(long, value_name = "NAME")]
    pub category: Option<String>,
    /// Seed of cameras, samples and noise
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// JSON file with further settings (see --print-config)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Print all settings as JSON and stop
    #[arg(long)]
    pub print_config: bool,
}

/// Arguments of `dvr export`.
#[derive(Args, Debug)]
pub struct ExportArgs {
    /// Folder of a run, or one of its checkpoints
    pub run: PathBuf,
    /// File to write, .safetensors
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
}

/// Arguments of `dvr predict`.
#[derive(Args, Debug)]
#[command(
    after_help = "Every picture becomes NAME.glb and NAME.ply (coloured, in object space) and NAME.png, a preview: what the \
encoder saw, the mesh from two sides, its normals. Pictures should look like those of the training: one object on white, \
filling the frame alike. An alpha channel is used where there is one."
)]
pub struct PredictArgs {
    /// Folder of a run on a dataset of objects, or one of its checkpoints
    pub run: PathBuf,
    /// Pictures, or folders of pictures
    #[arg(required = true)]
    pub images: Vec<PathBuf>,
    /// Folder for the meshes and previews
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Make again what is there already; without it, an interrupted call goes on where it stopped
    #[arg(long)]
    pub overwrite: bool,
    /// Folder of masks with the pictures' names, white on the object
    #[arg(long, value_name = "DIR", help_heading = "Finding the object", conflicts_with = "background")]
    pub masks: Option<PathBuf>,
    /// Take as object what differs from a plain background: white, black, or border (the picture's own edge colour)
    #[arg(long, value_name = "COLOR", help_heading = "Finding the object")]
    pub background: Option<BackgroundColor>,
    /// How much a pixel must differ from the plain background, of 255
    #[arg(
        long,
        default_value_t = 12,
        requires = "background",
        value_name = "LEVEL",
        help_heading = "Finding the object"
    )]
    pub background_threshold: u8,
    /// Cut a square around the object, a tenth of its size wider on each side; needs alpha, --masks or --background
    #[arg(long, help_heading = "Finding the object")]
    pub crop: bool,
    #[command(flatten)]
    pub surface: SurfaceArgs,
    #[command(flatten)]
    pub backend: BackendArg,
}

/// Arguments of `dvr import`.
#[derive(Args, Debug)]
#[command(
    after_help = "The run can then be given to mesh, render, eval, predict, export and train --resume: a network of one \
scene to mesh at once; a network with an encoder to predict; learned codes to mesh --object N. With --data, meshes come \
out in the scene's own coordinates, and training can go on."
)]
pub struct ImportArgs {
    /// Checkpoint of the original (zip or legacy), with or without its optimiser
    pub file: PathBuf,
    /// Folder of the run to make
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the run in --out
    #[arg(long)]
    pub overwrite: bool,
    /// The original's configuration of the checkpoint; what it inherits is found beside it
    #[arg(long, value_name = "FILE")]
    pub yaml: Option<PathBuf>,
    /// The scene or dataset that it was trained on
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    /// Latent codes of the objects, for a decoder without an encoder: NPZ with an array `codes`, a row an object
    #[arg(long, value_name = "FILE")]
    pub codes: Option<PathBuf>,
    /// The decoder was trained with `leaky: true`, which its tensors do not tell
    #[arg(long)]
    pub leaky: bool,
    #[command(flatten)]
    pub reading: SceneArgs,
}

/// Reads `90s`, `10m`, `2h` or plain seconds.
fn parse_duration(text: &str) -> Result<Duration, String> {
    let (number, factor) = match text.char_indices().last() {
        Some((i, 's')) => (&text[..i], 1.0),
        Some((i, 'm')) => (&text[..i], 60.0),
        Some((i, 'h')) => (&text[..i], 3600.0),
        _ => (text, 1.0),
    };
    let seconds: f64 = number.parse().map_err(|_| format!("{text:?} is no time; write 90s, 10m or 2h"))?;
    Duration::try_from_secs_f64(seconds * factor).map_err(|e| format!("{text:?}: {e}"))
}

/// Reads `3/16`.
fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    let shard = parts.map(|(number, of)| Shard { number, of }).filter(|shard| (1..=shard.of).contains(&shard.number));
    shard.ok_or_else(|| format!("{text:?} is no part; write 1/16, 2/16 and so on up to 16/16"))
}

/// Reads `name:key=value,key=value`.
fn parse_variant(text: &str) -> Result<Variant, String> {
    let error = || format!("{text:?} is no variant; write NAME:KEY=VALUE, e.g. no-texture:losses.texture=0");
    let (name, settings) = text.split_once(':').ok_or_else(error)?;
    let settings: Vec<String> = settings.split(',').map(str::to_owned).collect();
    let sound = !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || "-_".contains(c));
    if !sound || settings.iter().any(|setting| !setting.contains('=')) {
        return Err(error());
    }
    Ok(Variant { name: name.to_owned(), method: "fast".to_owned(), settings })
}

/// Reads a share from 0 to 1.
fn parse_share(text: &str) -> Result<f32, String> {
    let share = text.parse::<f32>().ok().filter(|share| (0.0..=1.0).contains(share));
    share.ok_or_else(|| format!("{text:?} is no share; write a number from 0 to 1, e.g. 0.0005"))
}

/// Reads `auto` or a number of cells.
fn parse_capacity(text: &str) -> Result<CapacityArg, String> {
    if text == "auto" {
        return Ok(CapacityArg::Auto);
    }
    let cells = text.parse::<usize>().ok().filter(|n| n.is_power_of_two() && (32..=512).contains(n));
    cells.map(CapacityArg::Cells).ok_or_else(|| format!("{text:?}: write auto, or a power of two from 32 to 512"))
}

/// Reads the size of a stored field, which cannot be nothing.
fn parse_bytes(text: &str) -> Result<usize, String> {
    let bytes = bytes_of(text).filter(|&n| n > 0).and_then(|n| usize::try_from(n).ok());
    bytes.ok_or_else(|| format!("{text:?} is no size; write 32000, 32k or 1M"))
}

/// Reads an amount of memory; 0 keeps nothing there.
fn parse_memory(text: &str) -> Result<u64, String> {
    bytes_of(text).ok_or_else(|| format!("{text:?} is no amount of memory; write 500M or 2G"))
}

/// `32000`, `32k`, `1M` or `2G` in bytes.
fn bytes_of(text: &str) -> Option<u64> {
    let (number, factor) = match text.char_indices().last() {
        Some((i, 'k' | 'K')) => (&text[..i], 1_000),
        Some((i, 'M')) => (&text[..i], 1_000_000),
        Some((i, 'G')) => (&text[..i], 1_000_000_000),
        _ => (text, 1),
    };
    number.parse::<u64>().ok().and_then(|n| n.checked_mul(factor))
}

/// Reads `64` or `320x240`.
fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let (width, height) = text.split_once('x').unwrap_or((text, text));
    let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16_384).contains(n));
    match (side(width), side(height)) {
        (Some(width), Some(height)) => Ok((width, height)),
        _ => Err(format!("{text:?} is no size; write 64 or 320x240, at most 16384")),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn times_and_sizes_are_read_or_refused() {
        assert_eq!(parse_duration("90s"), Ok(Duration::from_secs(90)));
        assert_eq!(parse_duration("1.5m"), Ok(Duration::from_secs(90)));
        assert!(parse_duration("soon").is_err() && parse_duration("-1s").is_err());
        assert_eq!(parse_size("320x240"), Ok((320, 240)));
        assert_eq!(parse_shard("3/16"), Ok(Shard { number: 3, of: 16 }));
        assert!(["0/3", "4/3", "3", "a/b", "1/0"].into_iter().all(|shard| parse_shard(shard).is_err()));
        assert_eq!(parse_capacity("64"), Ok(CapacityArg::Cells(64)));
        let variant = parse_variant("rough:losses.roughness=0,rays=99").unwrap();
        assert_eq!((variant.name.as_str(), variant.settings.len()), ("rough", 2));
        assert!(parse_variant("rough").is_err() && parse_variant("a/b:x=1").is_err() && parse_variant("a:b").is_err());
        assert!(parse_capacity("65").is_err() && parse_capacity("much").is_err());
        assert_eq!((parse_bytes("32k"), parse_bytes("1M")), (Ok(32_000), Ok(1_000_000)));
        assert!(parse_bytes("k").is_err() && parse_bytes("0").is_err());
        assert_eq!((parse_memory("2G"), parse_memory("0")), (Ok(2_000_000_000), Ok(0)));
        for wrong in ["-1", "2T", "1.5G", "G", "", "18446744073709551615k"] {
            assert!(parse_memory(wrong).is_err(), "{wrong}");
        }
        assert!(parse_size("0").is_err() && parse_size("axb").is_err());
    }
}
