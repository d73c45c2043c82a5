//! `dvr render`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::device::{BackendArg, MemoryArg};
use super::values::within;

/// Which cameras `dvr render` takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Cameras {
    /// A full turn around the object
    Orbit,
    /// The views of the scene that the run was trained on, for a mesh those of --data
    Dataset,
}

/// Arguments of `dvr render`.
#[derive(Args, Debug)]
pub struct RenderArgs {
    /// Folder of a run (its field or its mesh, whichever looks nearer to photographs), its scene.dvr or a checkpoint (the field), or a mesh with its texture (GLB, glTF, OBJ, PLY, OFF)
    #[arg(value_name = "RUN")]
    pub subject: PathBuf,
    /// Folder for the images
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the renders in --out
    #[arg(long)]
    pub overwrite: bool,
    /// Which object, counted from 0, for runs with one learned code per object [0 to 9999999]
    #[arg(long, value_parser = within(0usize, 9_999_999), value_name = "N")]
    pub object: Option<usize>,
    /// Cameras to render
    #[arg(long, value_enum, default_value_t = Cameras::Orbit)]
    pub cameras: Cameras,
    /// Number of frames of the orbit [1 to 3600]
    #[arg(long, default_value_t = 36, value_parser = within(1u32, 3600), value_name = "N")]
    pub frames: u32,
    /// Width and height of the orbit's frames, pixels [8 to 8192]
    #[arg(long, default_value_t = 256, value_parser = within(8u32, 8192), value_name = "PIXELS")]
    pub size: u32,
    /// Elevation of the orbit's cameras, degrees [-90 to 90]
    #[arg(long, default_value_t = 20.0, value_parser = within(-90.0, 90.0), allow_negative_numbers = true, value_name = "DEGREES")]
    pub elevation: f64,
    /// Axis of the orbit in object space [default: mean up direction of the scene's cameras; y for a mesh without --data]
    #[arg(long, value_enum)]
    pub up: Option<UpAxis>,
    /// Animation of the orbit
    #[arg(long, value_enum, default_value_t = Animation::Gif)]
    pub animation: Animation,
    /// Also write colour and z-depth as EXR (depth in scene units)
    #[arg(long)]
    pub exr: bool,
    /// Also write normals as PNG
    #[arg(long)]
    pub normals: bool,
    /// Colours that depend on the viewing direction, where the run found any
    #[arg(long, value_enum, default_value_t = ViewColorChoice::On)]
    pub view_color: ViewColorChoice,
    /// Samples across the object cube, where the field is rendered [2 to 8192]
    #[arg(long, default_value_t = 128, value_parser = within(2u32, 8192), value_name = "N")]
    pub samples: u32,
    /// The run's scene, if it was moved since training; for a mesh, the scene whose coordinates it has
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    #[command(flatten)]
    pub backend: BackendArg,
    #[command(flatten)]
    pub memory: MemoryArg,
}

/// Whether colours of a run depend on the viewing direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ViewColorChoice {
    /// As photographs show it
    On,
    /// The same colour from everywhere
    Off,
}

/// Axis of the orbit.
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
    /// turntable.mp4 (H.264), by ffmpeg
    Mp4,
    /// turntable.webm (VP9), by ffmpeg
    Webm,
    /// Frames only
    None,
}
