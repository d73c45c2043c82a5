//! `dvr bench`.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, ValueEnum};
use dvr_train::Supervision;

use super::MethodName;
use super::values::{parse_duration, parse_variant};

/// Arguments of `dvr bench`.
#[derive(Args, Debug)]
pub struct BenchArgs {
    /// Folders (or cameras files) of the scenes
    #[arg(required = true)]
    pub scenes: Vec<PathBuf>,
    /// Folder for results.json, results.csv, table.md, report.html, charts/ and the runs; runs that are there already
    /// are not repeated
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Methods to compare, as `dvr train --method` takes them; separate with commas
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [MethodName::Hull, MethodName::Fast], value_name = "METHOD")]
    pub methods: Vec<MethodName>,
    /// A variant of `fast` (or of METHOD, with method=METHOD) with a name and other settings, e.g.
    /// no-cross-view:losses.photo_consistency=0,losses.patch_ncc=0; may be given several times
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
    /// Follow the shape while it is trained, for curves of Chamfer-L1 over time; what that takes is not counted
    #[arg(long)]
    pub follow_shape: bool,
    /// Results from elsewhere, to stand in the same table: a results.json, or a list of {scene, method, seconds,
    /// chamfer_l1, ...}
    #[arg(long, value_name = "FILE")]
    pub overlay: Vec<PathBuf>,
}

impl BenchArgs {
    /// What is compared: the methods, then the variants.
    pub fn variants(&self) -> Vec<Variant> {
        Variant::all(&self.methods, &self.variant)
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

impl Variant {
    /// Methods with their own settings, then variants.
    pub fn all(methods: &[MethodName], variants: &[Self]) -> Vec<Self> {
        let name = |method: &MethodName| method.to_possible_value().map(|value| value.get_name().to_owned());
        let methods = methods.iter().filter_map(name);
        let methods = methods.map(|name| Self { method: name.clone(), name, settings: Vec::new() });
        methods.chain(variants.iter().cloned()).collect()
    }
}
