//! `dvr stress`.

use std::path::PathBuf;

use clap::Args;

use super::method::MethodName;
use super::values::within;
use super::variant::{Variant, parse_variant};

/// Arguments of `dvr stress`.
#[derive(Args, Debug)]
pub struct StressArgs {
    /// Folder for results.json, results.csv, table.md, charts/, report.html, the scenes and the cells; finished cells are
    /// not repeated
    #[arg(long, short, value_name = "DIR", required_unless_present = "list")]
    pub out: Option<PathBuf>,
    /// Only these axes, by name or by group (see --list); comma-separated
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    pub axis: Vec<String>,
    /// Methods to test, as in `dvr train --method`; comma-separated [default: hull, grid; with --full all four]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "METHOD")]
    pub methods: Vec<MethodName>,
    /// A named variant of `grid` (or of METHOD, with method=METHOD) with other settings, e.g. refined:refine_cameras=10, or
    /// trained by another build of dvr, e.g. before:program=OLD/dvr; repeatable
    #[arg(long, value_parser = parse_variant, value_name = "NAME:KEY=VALUE")]
    pub variant: Vec<Variant>,
    /// Test all other methods and variants (except the hull) only at the difficulty where this one first fails
    #[arg(long, value_name = "NAME")]
    pub against: Option<String>,
    /// Number of seeds, counted from 0, of scenes, faults and training [1 to 100; default: 1; with --full 3]
    #[arg(long, value_parser = within(1u64, 100), value_name = "N")]
    pub seeds: Option<u64>,
    /// All difficulties, all methods, three seeds: takes days. The default set takes minutes
    #[arg(long)]
    pub full: bool,
    /// List the axes with their difficulties and exit
    #[arg(long)]
    pub list: bool,
}

impl StressArgs {
    /// What is tested: methods, then variants.
    pub fn variants(&self) -> Vec<Variant> {
        let methods = match (self.methods.is_empty(), self.full) {
            (true, true) => &[MethodName("hull"), MethodName("grid"), MethodName("network"), MethodName("classic")][..],
            (true, false) => &[MethodName("hull"), MethodName("grid")],
            (false, _) => &self.methods,
        };
        Variant::all(methods, &self.variant)
    }

    /// Number of seeds, counted from 0.
    pub fn seeds(&self) -> u64 {
        self.seeds.unwrap_or(if self.full { 3 } else { 1 })
    }
}
