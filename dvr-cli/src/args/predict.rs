//! `dvr predict`.

use std::path::PathBuf;

use clap::Args;
use dvr_core::dataset::BackgroundColor;

use super::device::{BackendArg, MemoryArg};
use super::mesh::SurfaceArgs;
use super::symmetry::SymmetryArg;
use super::values::within;

/// Arguments of `dvr predict`.
#[derive(Args, Debug)]
#[command(
    after_help = "Each picture NAME gives NAME.glb and NAME.ply (coloured, in object space) and NAME.png, a preview: the encoder's \
input, the mesh from two sides, its normals; NAME.json says what these were made of. Pictures should look like the training pictures: one object on white that \
fills as much of the frame. An alpha channel is used as mask."
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
    /// Make all results again; otherwise those of the same picture, run, settings, program and machine are kept, which
    /// resumes an interrupted call
    #[arg(long)]
    pub overwrite: bool,
    /// Folder of masks with the pictures' names; the object is white
    #[arg(long, value_name = "DIR", help_heading = "Finding the object", conflicts_with = "background")]
    pub masks: Option<PathBuf>,
    /// Plain background, whose pixels are not object: white, black, or border (the colour of the picture's border)
    #[arg(long, value_name = "COLOR", help_heading = "Finding the object")]
    pub background: Option<BackgroundColor>,
    /// How far a pixel's colour must be from the plain background [0 to 255]
    #[arg(
        long,
        default_value_t = 12,
        value_parser = within(0u8, 255),
        requires = "background",
        value_name = "LEVEL",
        help_heading = "Finding the object"
    )]
    pub background_threshold: u8,
    /// Crop to a square around the object with a margin of a tenth; needs an alpha channel, --masks or --background
    #[arg(long, help_heading = "Finding the object")]
    pub crop: bool,
    /// Occupancy at which the surface lies: lower takes in what is less certain, as thin parts are; where nothing
    /// comes to it, the likeliest points make the surface [0.001 to 0.999; default: that of
    /// the training]
    #[arg(long, value_parser = within(0.001f64, 0.999), value_name = "OCCUPANCY")]
    pub threshold: Option<f64>,
    /// Whether objects are taken for their own mirror images: one that is not is better seen without [default: as the
    /// training found, which config.json says]
    #[arg(long, value_enum, value_name = "WHETHER")]
    pub symmetry: Option<SymmetryArg>,
    #[command(flatten)]
    pub surface: SurfaceArgs,
    #[command(flatten)]
    pub backend: BackendArg,
    #[command(flatten)]
    pub memory: MemoryArg,
}
