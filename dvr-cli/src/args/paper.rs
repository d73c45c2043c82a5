//! `dvr paper`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use super::values::within;

/// Arguments of `dvr paper`.
#[derive(Args, Debug)]
#[command(
    after_help = "Each table is made on the data that you have: ShapeNet renders in the layout of DVR, or a dataset made by `dvr synth`; DTU \
scans, or any other scenes. Published figures stand beside ours, and are of ShapeNet: on other data only the order of \
systems can be compared.

What is finished is kept in DIR: the same command continues. Interrupted trainings of shapenet go on where they were.

Examples:
  dvr paper --table shapenet --data furniture/data --out DIR --plan      how long it takes
  dvr paper --table shapenet --data furniture/data --out DIR
  dvr paper --table shapenet --data furniture/data --out DIR --by-heart 10
  dvr paper --table dtu --data dtu/scan65 dtu/scan106 --reference DTU --cloud furu=points/furu{scan}_l3.ply --out DIR
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
    /// Points of another program, with normals, as rows NAME-0, NAME-5 and NAME-7 (trimmed at these depths): {scene} stands for the
    /// name of the scene's folder, {scan} for its number with three digits; repeatable
    #[arg(long = "cloud", value_name = "NAME=FILE", help_heading = "Scans (dtu)")]
    pub clouds: Vec<NamedCloud>,
    /// Verified points, by the name of their file in each scene's folder, e.g. verified_points.npz; they judge scenes that have no
    /// true surface [default: the sparse points of the scene]
    #[arg(long, value_name = "NAME", help_heading = "Scans (dtu)")]
    pub points: Option<PathBuf>,
    /// Folder of DTU's evaluation data (ObsMask, Points), whose protocol then judges [default: the scenes' true surfaces, or else
    /// their verified points]
    #[arg(long, value_name = "DIR", help_heading = "Scans (dtu)")]
    pub reference: Option<PathBuf>,
    /// Rows to make: drc, softras, dvr, dvr-local, drc-depth, dvr-depth, dvr-local-depth, dvr-rgb-depth, r2n2, psgn, atlasnet,
    /// pixel2mesh, onet, mean-shape, nearest-picture; of dtu: hull, classic, grid, stereo-poisson-0 (-5, -7) and those of --cloud;
    /// comma-separated [default: all]
    #[arg(long, value_delimiter = ',', value_name = "ROW")]
    pub rows: Vec<String>,
    /// Optimiser steps of each training [1 to 100000000; default: those of each method]
    #[arg(long, value_parser = within(1usize, 100_000_000), value_name = "N", help_heading = "Single pictures (shapenet)")]
    pub steps: Option<usize>,
    /// What makes the code of a picture in all rows but those with features of places: convolutional-bn, convolutional, or the paper's
    /// resnet18 [default: that of each method]
    #[arg(long, value_name = "KIND", value_parser = ["convolutional-bn", "convolutional", "resnet18"], help_heading = "Single pictures (shapenet)")]
    pub encoder: Option<String>,
    /// Cells along an edge at which the fields' surfaces are measured [16 to 1024]
    #[arg(long, default_value_t = 64, value_parser = within(16usize, 1024), value_name = "CELLS", help_heading = "Single pictures (shapenet)")]
    pub resolution: usize,
    /// Learn N objects by heart, spread over the categories, and measure these: how near each representation comes to what it has seen [1 to
    /// 1000]
    #[arg(long, value_parser = within(1usize, 1000), value_name = "N", help_heading = "Single pictures (shapenet)")]
    pub by_heart: Option<usize>,
}

/// A file of points and its name in the table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedCloud {
    /// The name.
    pub name: String,
    /// The file, with what stands for the scene.
    pub file: String,
}

impl FromStr for NamedCloud {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            Some((name, file)) if is_name(name) && !file.is_empty() => {
                Ok(Self { name: name.to_owned(), file: file.to_owned() })
            }
            _ => Err("write NAME=FILE, e.g. furu=points/furu{scan}_l3.ply; a name has letters, digits, - and _".into()),
        }
    }
}

fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// Tables of Niemeyer et al. 2020.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PaperTable {
    /// A shape from a single picture, by DVR and by the systems that it is compared with, from 2D, 2.5D and 3D
    Shapenet,
    /// Many views against scans: the hull, the paper's network, the default, and screened Poisson surfaces of points: those of our
    /// stereo depth maps, and of other programs
    Dtu,
    /// Many views: samples on a ray
    Samples,
    /// Many views: the weight of the smoothness of normals
    Smoothness,
    /// Many views: from pictures, from depth maps, and from both
    Depth,
}
