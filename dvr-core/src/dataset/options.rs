//! How a scene is to be read.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use crate::camera::Similarity;
use crate::cancellation::Cancellation;
use crate::error::{Error, Result};
use crate::hold_out::HOLD_OUT_EVERY;
use crate::hull::Bounds;
use crate::view_split::ViewNames;

/// A layout of posed photographs, by its name: [`Format::all`] tells which there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub struct Format(pub(super) &'static str);

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl<'de> serde::Deserialize<'de> for Format {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        <String as serde::Deserialize>::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// How to separate the object from a plain background, for pictures without masks.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Background {
    /// Its colour.
    pub color: BackgroundColor,
    /// A pixel is object where a channel differs from the background's by more than this, of 255.
    pub threshold: u8,
}

impl Background {
    /// A background of that colour, with the default threshold.
    pub fn of(color: BackgroundColor) -> Self {
        Self { color, threshold: 12 }
    }
}

/// The colour of a plain background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BackgroundColor {
    /// Pure white.
    White,
    /// Pure black.
    Black,
    /// Each picture's own: the median of its outermost pixels.
    Border,
}

impl FromStr for BackgroundColor {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name.to_lowercase().as_str() {
            "white" => Ok(Self::White),
            "black" => Ok(Self::Black),
            "border" | "auto" => Ok(Self::Border),
            _ => Err(Error::UnknownName {
                what: "background",
                name: name.to_owned(),
                expected: "white, black, border".into(),
            }),
        }
    }
}

/// Who says where the object is.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Normalise {
    /// The files where they promise the unit cube (the DVR layout), else the masks, bounded by the files' sphere, and where
    /// the frame cuts masks by sparse points or what all cameras look at.
    #[default]
    Auto,
    /// The files: `scale_mat` as it is. For the IDR layout its sphere, inscribed in the cube.
    Files,
    /// The masks: the visual hull fills the unit cube, less a margin. As for [`Normalise::Auto`], without the files' sphere.
    Hull,
    /// The caller: this similarity takes the unit cube to the world of the files.
    Given(Similarity),
    /// The caller: this box, in the world of the files, holds the object. It lies in the unit cube as the box of a visual
    /// hull would, with the axes of the world.
    Box(Bounds),
}

/// How a scene is to be read; the default reads everything, at full size.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default)]
pub struct ReadOptions {
    /// The layout; found out where it is not given.
    pub format: Option<Format>,
    /// Each `downscale` x `downscale` pixels become one (the mean; the camera is scaled exactly, a rest at the right
    /// and lower edge is cut off). 1 keeps the size.
    pub downscale: u32,
    /// Make the masks from a plain background, whether or not the files have masks.
    pub background: Option<Background>,
    /// A folder of masks to use in place of the files' own: for each view its name with `.png`, of the picture as it is read,
    /// upright and undistorted, at its size or another. A view that has none there has no mask.
    pub masks: Option<PathBuf>,
    /// At most this many views to train on, spread evenly over those there are. Views of other splits all stay.
    pub n_views: Option<usize>,
    /// Views to leave out, by name, or by number in the order of the files, from 0.
    pub ignored_views: Vec<String>,
    /// The views of an earlier reading, by name and by what they are for. Only these are read, whatever `n_views` and
    /// `ignored_views` say; a warning names views that came since then. Not stored with the other options.
    #[serde(skip)]
    pub known_views: Option<ViewNames>,
    /// The share of views that [`Scene::hold_out`](crate::Scene::hold_out) is going to take for testing. Views for
    /// testing, those of the dataset and these, have no say in where the object is, nor in which sparse points lie on
    /// it, as long as two others have masks. Not stored with the other options.
    #[serde(skip)]
    pub hold_out_every: usize,
    /// Who says where the object is.
    pub normalise: Normalise,
    /// DVR layout: take depth from `visual_hull_depth/`, even where there is a `depth/`.
    pub visual_hull_depth: bool,
    /// Bytes of decoded photographs and masks that are kept in memory (4 per pixel); what is beyond lies in a scratch
    /// file in the system's temporary folder and is paged in as it is read. Without, everything is in memory. What is
    /// computed is the same either way. Depth maps stay in memory, and so do refined masks where everything else fits.
    pub max_memory: Option<u64>,
    /// Ends the reading early, with [`Error::Cancelled`].
    #[serde(skip)]
    pub cancellation: Cancellation,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            format: None,
            downscale: 1,
            background: None,
            masks: None,
            n_views: None,
            ignored_views: Vec::new(),
            known_views: None,
            hold_out_every: HOLD_OUT_EVERY,
            normalise: Normalise::Auto,
            visual_hull_depth: false,
            max_memory: None,
            cancellation: Cancellation::default(),
        }
    }
}
