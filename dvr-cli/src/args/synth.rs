//! `dvr synth`.

use std::path::PathBuf;

use clap::Args;

use super::values::{parse_size, within};

/// Arguments of `dvr synth`.
#[derive(Args, Debug)]
pub struct SynthArgs {
    /// Meshes (OBJ, PLY, OFF, GLB, glTF), or folders of meshes; the folder's name becomes the category
    #[arg(required_unless_present = "print_config")]
    pub meshes: Vec<PathBuf>,
    /// Folder of the dataset
    #[arg(long, short, value_name = "DIR", required_unless_present = "print_config")]
    pub out: Option<PathBuf>,
    /// Views per object [1 to 10000]
    #[arg(long, default_value_t = 24, value_parser = within(1u32, 10_000), value_name = "N")]
    pub views: u32,
    /// Width and height in pixels, e.g. 64 or 320x240 [1 to 16384]
    #[arg(long, default_value = "64", value_parser = parse_size, value_name = "SIZE")]
    pub size: (u32, u32),
    /// Category of meshes given as files [default: the folder's name]
    #[arg(long, value_name = "NAME")]
    pub category: Option<String>,
    /// Seed of cameras, samples and noise
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub seed: u64,
    /// JSON file with further settings (see --print-config)
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Print all settings as JSON and exit
    #[arg(long)]
    pub print_config: bool,
}
