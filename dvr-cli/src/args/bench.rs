//! `dvr bench`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use dvr_train::Supervision;

use super::method::MethodName;
use super::values::{parse_duration, within};
use super::variant::{Variant, parse_variant};

/// Arguments of `dvr bench`.
#[derive(Args, Debug)]
pub struct BenchArgs {
    /// Folders (or cameras files) of the scenes
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Folder for results.json, results.csv, table.md, report.html, charts/ and the runs; finished runs are not repeated
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Methods to compare, as in `dvr train --method`; comma-separated
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [MethodName("hull"), MethodName("grid")], value_name = "METHOD")]
    pub methods: Vec<MethodName>,
    /// A named variant of `grid` (or of METHOD, with method=METHOD) with other settings, e.g.
    /// no-photo-consistency:losses.photo_consistency.weight=0,losses.patch_ncc.weight=0, or trained by another build of dvr,
    /// e.g. before:program=OLD/dvr; repeatable
    #[arg(long, value_parser = parse_variant, value_name = "NAME:KEY=VALUE")]
    pub variant: Vec<Variant>,
    /// What supervises the shape: rgb, depth, rgb+depth; comma-separated
    #[arg(long, value_delimiter = ',', default_value = "rgb", value_name = "WHAT")]
    pub supervision: Vec<Supervision>,
    /// Number of seeds, counted from 0 [1 to 100]
    #[arg(long, default_value_t = 3, value_parser = within(1u64, 100), value_name = "N")]
    pub seeds: u64,
    /// Time limit of each training, e.g. 10m [0s to 8760h]
    #[arg(long, value_parser = parse_duration, value_name = "TIME")]
    pub time: Option<Duration>,
    /// Name of a file of verified points (PLY or NPZ, as for `dvr eval --points`) in the folders of the scenes. Meshes of
    /// scenes that have one are measured by it, e.g. verified_points.npz
    #[arg(long, value_name = "NAME")]
    pub points: Option<PathBuf>,
    /// Average NxN pixels of all scenes into one [1 to 64]
    #[arg(long, value_parser = within(1u32, 64), value_name = "N")]
    pub downscale: Option<u32>,
    /// Measure Chamfer-L1 at each validation, for curves over time; the clocks stop meanwhile
    #[arg(long)]
    pub follow_shape: bool,
    /// Add results of other software to the tables: a results.json, or a list of {scene, method, seconds, chamfer_l1,
    /// ...}
    #[arg(long, value_name = "FILE")]
    pub overlay: Vec<PathBuf>,
}

impl BenchArgs {
    /// What is compared: the methods, then the variants.
    pub fn variants(&self) -> Vec<Variant> {
        Variant::all(&self.methods, &self.variant)
    }
}
