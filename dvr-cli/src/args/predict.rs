//! `dvr predict`.

use std::path::PathBuf;

use clap::Args;
use dvr_core::dataset::BackgroundColor;

use super::{BackendArg, MemoryArg, SurfaceArgs};

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
    #[command(flatten)]
    pub memory: MemoryArg,
}
