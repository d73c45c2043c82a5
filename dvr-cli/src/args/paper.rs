//! `dvr paper`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::values::within;

/// Arguments of `dvr paper`.
#[derive(Args, Debug)]
#[command(
    after_help = "Each table is made on the data that you have: ShapeNet renders in the layout of DVR, or a dataset made by `dvr synth`; DTU \
scans, or any other scenes. Published figures stand beside ours, and are of ShapeNet: on other data only the order of \
systems can be compared.

What is finished is kept in DIR, and an interrupted training goes on where it was: the same command continues.

Examples:
  dvr paper --table shapenet --data furniture/data --out DIR --plan      how long it takes
  dvr paper --table shapenet --data furniture/data --out DIR
  dvr paper --table shapenet --data furniture/data --out DIR --by-heart 10
  dvr paper --table depth --data scenes/bunny scenes/sharp --out DIR"
)]
pub struct PaperArgs {
    /// The table
    #[arg(long, value_enum, value_name = "TABLE")]
    pub table: PaperTable,
    /// Dataset of objects (shapenet), or scenes (the other tables)
    #[arg(long, required = true, num_args = 1.., value_name = "PATH")]
    pub data: Vec<PathBuf>,
    /// Folder for table.md, table.csv and report.html, with the runs, or for those of `dvr bench`
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of seeds, counted from 0 [1 to 100]
    #[arg(long, default_value_t = 1, value_parser = within(1u64, 100), value_name = "N")]
    pub seeds: u64,
    /// Say what will be made and about how long it takes on two cores, and exit
    #[arg(long)]
    pub plan: bool,
    /// Rows to make: drc, softras, dvr, dvr-local, drc-depth, dvr-depth, dvr-local-depth, dvr-rgb-depth, r2n2, psgn, atlasnet,
    /// pixel2mesh, onet, mean-shape, nearest-picture; comma-separated [default: all]
    #[arg(long, value_delimiter = ',', value_name = "ROW", help_heading = "Single pictures (shapenet)")]
    pub rows: Vec<String>,
    /// Optimiser steps of each training [1 to 100000000; default: those of each method]
    #[arg(long, value_parser = within(1usize, 100_000_000), value_name = "N", help_heading = "Single pictures (shapenet)")]
    pub steps: Option<usize>,
    /// Cells along an edge at which the fields' surfaces are measured [16 to 1024]
    #[arg(long, default_value_t = 64, value_parser = within(16usize, 1024), value_name = "CELLS", help_heading = "Single pictures (shapenet)")]
    pub resolution: usize,
    /// Learn N objects by heart, spread over the categories, and measure these: how near each representation comes to what it has seen [1 to
    /// 1000]
    #[arg(long, value_parser = within(1usize, 1000), value_name = "N", help_heading = "Single pictures (shapenet)")]
    pub by_heart: Option<usize>,
}

/// Tables of Niemeyer et al. 2020.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PaperTable {
    /// A shape from a single picture, by DVR and by the systems that it is compared with, from 2D, 2.5D and 3D
    Shapenet,
    /// Many views: samples on a ray
    Samples,
    /// Many views: the weight of the smoothness of normals
    Smoothness,
    /// Many views: from pictures, from depth maps, and from both
    Depth,
}
