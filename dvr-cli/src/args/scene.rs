//! How a scene is read, and `dvr info`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dvr_core::dataset::{Background, BackgroundColor, Format, Normalise, ReadOptions};

use super::values::parse_memory;

/// How a scene is read.
#[derive(Args, Clone, Debug)]
#[command(next_help_heading = "Reading the scene")]
pub struct SceneArgs {
    /// Layout of the files: dvr, transforms (NeRF, nerfstudio), idr (IDR, NeuS), middlebury or colmap [default: found
    /// by looking]
    #[arg(long)]
    pub format: Option<Format>,
    /// Average this many by this many pixels into one
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=64), value_name = "N")]
    pub downscale: u32,
    /// Take as mask what differs from a plain background: white, black, or border (each picture's own edge colour)
    #[arg(long, value_name = "COLOR")]
    pub background: Option<BackgroundColor>,
    /// How much a pixel must differ from the plain background, of 255
    #[arg(long, default_value_t = 12, requires = "background", value_name = "LEVEL")]
    pub background_threshold: u8,
    /// Train on masks as they are. Without, mask files are refined for training where the photograph's colours show that
    /// they leave out parts of the object, or have a rim of background; figures always use masks as they are
    #[arg(long)]
    pub no_mask_refinement: bool,
    /// Use at most this many training views, spread evenly
    #[arg(long, value_name = "N")]
    pub views: Option<usize>,
    /// Leave out views, by name or by number from 0; separate with commas
    #[arg(long, value_delimiter = ',', value_name = "VIEW")]
    pub ignore: Vec<String>,
    /// Who says where the object is: auto, files (trust scale_mat) or hull (from the masks)
    #[arg(long, value_enum, default_value_t = NormaliseArg::Auto, value_name = "HOW")]
    pub normalise: NormaliseArg,
    /// DVR layout: take depth from visual_hull_depth/
    #[arg(long)]
    pub visual_hull_depth: bool,
    /// Decoded photographs above this, e.g. 500M or 2G, are kept in a scratch file instead of memory; the system pages
    /// them in as they are read. The file lies in the temporary folder (set TMPDIR to a folder on a disk with room: 4
    /// bytes a pixel) and goes away by itself; results are the same. With --backend gpu, also the most that tensors may
    /// take on the graphics processor: work is cut to fit, and training whose step cannot fit is refused [default: all
    /// in memory]
    #[arg(long, value_parser = parse_memory, value_name = "BYTES")]
    pub memory: Option<u64>,
}

/// Who says where the object is.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum NormaliseArg {
    /// The files where they promise the unit cube, else the masks
    Auto,
    /// The files
    Files,
    /// The masks
    Hull,
}

impl SceneArgs {
    /// As the library takes it.
    pub fn read_options(&self) -> ReadOptions {
        ReadOptions {
            format: self.format,
            downscale: self.downscale,
            background: self.background.map(|color| Background { color, threshold: self.background_threshold }),
            n_views: self.views,
            ignored_views: self.ignore.clone(),
            normalise: match self.normalise {
                NormaliseArg::Auto => Normalise::Auto,
                NormaliseArg::Files => Normalise::Files,
                NormaliseArg::Hull => Normalise::Hull,
            },
            visual_hull_depth: self.visual_hull_depth,
            max_memory: self.memory,
        }
    }
}

/// Arguments of `dvr info`.
#[derive(Args, Debug)]
pub struct InfoArgs {
    /// Folder (or cameras file) of the scene
    pub scene: PathBuf,
    #[command(flatten)]
    pub reading: SceneArgs,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}
