//! What a shape is learned from.

use serde::{Deserialize, Serialize};

/// Which measurements the shape is learned from. Masks are used in every case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Supervision {
    /// Photographs and masks: colour is compared where the predicted surface is seen.
    #[default]
    Rgb,
    /// Depth maps and masks; the texture is learned from the photographs without shaping the surface.
    Depth,
    /// Both.
    RgbDepth,
    /// Points of the cube of which the dataset says whether they are inside: 3D supervision, for comparison, and for
    /// datasets of objects only. There is no texture then.
    Occupancy,
}

impl std::fmt::Display for Supervision {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Rgb => "rgb",
            Self::Depth => "depth",
            Self::RgbDepth => "rgb+depth",
            Self::Occupancy => "occupancy",
        })
    }
}

impl std::str::FromStr for Supervision {
    type Err = String;

    fn from_str(s: &str) -> std::result::Result<Self, String> {
        match s {
            "rgb" => Ok(Self::Rgb),
            "depth" => Ok(Self::Depth),
            "rgb+depth" | "rgb-depth" => Ok(Self::RgbDepth),
            "occupancy" => Ok(Self::Occupancy),
            other => Err(format!("{other:?} is no supervision; choose rgb, depth, rgb+depth or occupancy")),
        }
    }
}
