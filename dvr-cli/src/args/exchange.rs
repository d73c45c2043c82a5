//! `dvr import` and `dvr export`.

use std::path::PathBuf;

use clap::Args;

use super::scene::SceneArgs;

/// Arguments of `dvr export`.
#[derive(Args, Debug)]
pub struct ExportArgs {
    /// Folder of a run, or one of its checkpoints
    pub run: PathBuf,
    /// File to write, .safetensors
    #[arg(long, short, value_name = "FILE")]
    pub out: PathBuf,
    /// Replace the file at --out
    #[arg(long)]
    pub overwrite: bool,
}

/// Arguments of `dvr import`.
#[derive(Args, Debug)]
#[command(
    after_help = "The imported run works with mesh, render, eval, predict, export and train --resume: use mesh for a network of \
one scene, predict for a network with an encoder, mesh --object N for learned codes. With --data, meshes are in the scene's \
coordinates and training can be resumed."
)]
pub struct ImportArgs {
    /// Checkpoint of DVR's reference code (.pt, zip or legacy format), with or without its optimiser
    pub file: PathBuf,
    /// Folder of the new run
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Replace the run in --out
    #[arg(long)]
    pub overwrite: bool,
    /// The checkpoint's YAML configuration; configurations that it inherits from are looked up beside it
    #[arg(long, value_name = "FILE")]
    pub yaml: Option<PathBuf>,
    /// Scene or dataset that it was trained on
    #[arg(long, value_name = "SCENE")]
    pub data: Option<PathBuf>,
    /// Latent codes of the objects, for a decoder without an encoder: NPZ with an array `codes`, one row per object
    #[arg(long, value_name = "FILE")]
    pub codes: Option<PathBuf>,
    /// The decoder was trained with `leaky: true` (the checkpoint does not record it)
    #[arg(long)]
    pub leaky: bool,
    #[command(flatten)]
    pub reading: SceneArgs,
}
