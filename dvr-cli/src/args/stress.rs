//! `dvr stress`.

use std::path::PathBuf;

use clap::Args;

use super::values::parse_variant;
use super::{MethodName, Variant};

/// Arguments of `dvr stress`.
#[derive(Args, Debug)]
pub struct StressArgs {
    /// Folder for results.json, results.csv, table.md, the scenes and the cells; cells that are there already are not
    /// repeated
    #[arg(long, short, value_name = "DIR", required_unless_present = "list")]
    pub out: Option<PathBuf>,
    /// Only these axes, by name or by group (see --list); separate with commas
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    pub axis: Vec<String>,
    /// Methods to try, as `dvr train --method` takes them; separate with commas [default: hull, fast; with --full all
    /// four]
    #[arg(long, value_enum, value_delimiter = ',', value_name = "METHOD")]
    pub methods: Vec<MethodName>,
    /// A variant of `fast` (or of METHOD, with method=METHOD) with a name and other settings, e.g.
    /// refined:refine_cameras=10; may be given several times
    #[arg(long, value_parser = parse_variant, value_name = "NAME:KEY=VALUE")]
    pub variant: Vec<Variant>,
    /// Try other methods and variants, but the hull, only where this one first fails: does another hold longer?
    #[arg(long, value_name = "NAME")]
    pub against: Option<String>,
    /// Seeds from 0 on, of scenes, faults and training [default: 1; with --full 3]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=100), value_name = "N")]
    pub seeds: Option<u64>,
    /// All difficulties, all methods, three seeds: days. The quick set takes minutes
    #[arg(long)]
    pub full: bool,
    /// List the axes with their difficulties and stop
    #[arg(long)]
    pub list: bool,
}

impl StressArgs {
    /// What is tried: methods, then variants.
    pub fn variants(&self) -> Vec<Variant> {
        use MethodName::{Classic, Fast, Hull, Network};
        let methods = match (self.methods.is_empty(), self.full) {
            (true, true) => &[Hull, Fast, Network, Classic][..],
            (true, false) => &[Hull, Fast],
            (false, _) => &self.methods,
        };
        Variant::all(methods, &self.variant)
    }

    /// Seeds from 0 on.
    pub fn seeds(&self) -> u64 {
        self.seeds.unwrap_or(if self.full { 3 } else { 1 })
    }
}
