//! `dvr import` and `dvr export`.

use std::path::PathBuf;

use clap::Args;

use super::SceneArgs;

/// Arguments of `dvr export`.
#[derive(Args, Debug)]
pub struct ExportArgs {
    /// Folder of a run, or one of its checkpoints
    pub run: PathBuf,
    /// File to write, .safetensors
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
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
