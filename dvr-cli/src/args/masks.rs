//! Where masks come from, and `dvr masks`.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use dvr_segmentation::MaskCommand;

use super::scene::SceneArgs;

/// Where masks come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MasksFrom {
    /// The scene's own; where no view has one, they are found from all views.
    Auto,
    /// All that lies in a cube around what is in the middles of pictures; no view may have one.
    Cube,
    /// What is learned of the object together with the background; no view may have one.
    Off,
    /// The scene's own.
    Given,
    /// A folder, by the names of the views.
    Folder(PathBuf),
}

impl MasksFrom {
    /// Its word, where it asks for masks in a certain way where no view has one.
    pub fn asks_for(&self) -> Option<&'static str> {
        match self {
            Self::Cube => Some("cube"),
            Self::Off => Some("off"),
            Self::Auto | Self::Given | Self::Folder(_) => None,
        }
    }
}

impl FromStr for MasksFrom {
    type Err = Infallible;

    fn from_str(value: &str) -> Result<Self, Infallible> {
        Ok(match value {
            "auto" => Self::Auto,
            "cube" => Self::Cube,
            "off" => Self::Off,
            "given" => Self::Given,
            folder => Self::Folder(folder.into()),
        })
    }
}

/// What makes masks where no view has one.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Reading the scene")]
pub struct SegmentArg {
    /// Make masks by a program, run once per photograph, in place of finding them from all views: its command line, in which
    /// {in} stands for the path of the picture (PNG, upright and undistorted) and {out} for that of the mask (PNG, of the same
    /// size: its alpha channel, else what is bright), e.g. "rembg i {in} {out}". Words are split as a shell does; no shell is
    /// started. For scenes in which no view has a mask
    #[arg(long, value_name = "COMMAND", conflicts_with = "background")]
    pub segment: Option<MaskCommand>,
}

/// Arguments of `dvr masks`.
#[derive(Args, Debug)]
pub struct MasksArgs {
    /// Folder (or cameras file) of a scene whose pictures have no masks
    pub scene: PathBuf,
    /// Folder for the masks: for each view its name with .png
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the masks that the folder has
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    pub segment: SegmentArg,
    #[command(flatten)]
    pub reading: SceneArgs,
}
