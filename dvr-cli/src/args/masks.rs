//! Where masks come from, and `dvr masks`.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;

use super::scene::SceneArgs;

/// Where masks come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MasksFrom {
    /// The scene's own; where no view has one, they are found from all views.
    Auto,
    /// The scene's own.
    Given,
    /// A folder, by the names of the views.
    Folder(PathBuf),
}

impl FromStr for MasksFrom {
    type Err = Infallible;

    fn from_str(value: &str) -> Result<Self, Infallible> {
        Ok(match value {
            "auto" => Self::Auto,
            "given" => Self::Given,
            folder => Self::Folder(folder.into()),
        })
    }
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
    pub reading: SceneArgs,
}
