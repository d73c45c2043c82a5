//! How a scene is read, and `dvr info`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use dvr_core::dataset::{Background, BackgroundColor, Format, Normalise, ReadOptions};
use dvr_core::hull::Bounds;

use super::masks::MasksFrom;
use super::values::{parse_box, parse_memory, within};

/// How a scene is read.
#[derive(Args, Clone, Debug, Default)]
#[command(next_help_heading = "Reading the scene")]
pub struct SceneArgs {
    /// Layout of the files: dvr, transforms (NeRF, nerfstudio), idr (IDR, NeuS), llff, middlebury or colmap [default:
    /// detected]
    #[arg(long)]
    pub format: Option<Format>,
    /// Average NxN pixels into one [1 to 64; default: 1]
    #[arg(long, value_parser = within(1u32, 64), value_name = "N")]
    pub downscale: Option<u32>,
    /// Where masks come from: auto (the scene's own; where no view has one, `dvr train` finds them from all views together),
    /// off (where no view has one: object and background are learned together, and what is learned around the middle is the
    /// object), cube (where no view has one: all that lies in a cube around what is in the middles of the pictures, for a part of
    /// something larger), given (the scene's own, nothing else), or a folder with NAME.png for each view, e.g. those of
    /// `dvr masks` [default: auto]
    #[arg(long, value_name = "WHERE", value_parser = clap::value_parser!(MasksFrom), conflicts_with = "background")]
    pub masks: Option<MasksFrom>,
    /// Plain background, from which masks are made: white, black, or border (the colour of each picture's border)
    #[arg(long, value_name = "COLOR")]
    pub background: Option<BackgroundColor>,
    /// How far a pixel's colour must be from the plain background [0 to 255; default: 12]
    #[arg(long, value_parser = within(0u8, 255), requires = "background", value_name = "LEVEL")]
    pub background_threshold: Option<u8>,
    /// Train on masks as they are. By default mask files are refined for training where the photograph's colours show that
    /// parts of the object are missing or that a rim of background is included; metrics always use the masks as given
    #[arg(long)]
    pub no_mask_refinement: bool,
    /// Use at most this many training views, spread evenly [1 to 1000000]
    #[arg(long, value_parser = within(1usize, 1_000_000), value_name = "N")]
    pub views: Option<usize>,
    /// Leave out views, by name or by number from 0; comma-separated
    #[arg(long, value_delimiter = ',', value_name = "VIEW")]
    pub ignore: Vec<String>,
    /// How the object is centred and scaled to the unit cube [default: auto]
    #[arg(long, value_enum, value_name = "HOW")]
    pub normalise: Option<NormaliseArg>,
    /// Where the object is, where that is not found: two opposite corners, in the units of the files, as `dvr info` prints
    /// the region; e.g. --box "(-1,-1,0) to (1,1,2.5)". The cube around it, with a margin, is what is modelled
    #[arg(long = "box", value_parser = parse_box, value_name = "CORNERS", conflicts_with = "normalise", allow_hyphen_values = true)]
    pub bounds: Option<Bounds>,
    /// DVR layout: read depth maps from visual_hull_depth/
    #[arg(long)]
    pub visual_hull_depth: bool,
    /// Memory limit, e.g. 500M or 2G. Decoded photographs beyond it are paged from a scratch file in the temporary folder
    /// (TMPDIR; 4 bytes per pixel), which is removed at the end; results are the same. What would take more beside them is
    /// refused before it starts. With --backend gpu it limits photographs, and the GPU memory of tensors: work is split to
    /// fit, and training whose step cannot fit is refused
    /// [0 to 1000000G; default: what the machine has]
    #[arg(long, value_parser = parse_memory, value_name = "BYTES")]
    pub memory: Option<u64>,
}

/// How the object is centred and scaled to the unit cube.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum NormaliseArg {
    /// By the files where they promise the unit cube, else by the masks, bounded by the files' sphere, sparse points or what
    /// all cameras look at where the frame cuts masks
    Auto,
    /// By the files (scale_mat)
    Files,
    /// By the visual hull of the masks
    Hull,
}

impl NormaliseArg {
    /// As the library has it.
    pub fn normalise(self) -> Normalise {
        match self {
            Self::Auto => Normalise::Auto,
            Self::Files => Normalise::Files,
            Self::Hull => Normalise::Hull,
        }
    }
}

impl SceneArgs {
    /// The plain background, where there is one.
    pub fn background(&self) -> Option<Background> {
        let background = Background::of(self.background?);
        Some(Background { threshold: self.background_threshold.unwrap_or(background.threshold), ..background })
    }

    /// Who says where the object is, where that was given.
    pub fn normalised(&self) -> Option<Normalise> {
        self.bounds.map(Normalise::Box).or(self.normalise.map(NormaliseArg::normalise))
    }

    /// The library's options.
    pub fn read_options(&self) -> ReadOptions {
        ReadOptions {
            format: self.format,
            downscale: self.downscale.unwrap_or(1),
            background: self.background(),
            masks: match &self.masks {
                Some(MasksFrom::Folder(folder)) => Some(folder.canonicalize().unwrap_or_else(|_| folder.clone())),
                _ => None,
            },
            n_views: self.views,
            ignored_views: self.ignore.clone(),
            normalise: self.normalised().unwrap_or_default(),
            visual_hull_depth: self.visual_hull_depth,
            max_memory: self.memory,
            ..ReadOptions::default()
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
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}
