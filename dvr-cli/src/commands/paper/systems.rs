//! The rows of the table of single pictures.

use dvr_train::Supervision;

/// What a system learns from, as the publication groups them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// Pictures and masks.
    Pictures,
    /// Depth maps.
    DepthMaps,
    /// True shapes.
    Shapes,
    /// A lookup of true shapes.
    Lookup,
}

impl Group {
    /// Its name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pictures => "2D",
            Self::DepthMaps => "2.5D",
            Self::Shapes => "3D",
            Self::Lookup => "lookup",
        }
    }
}

/// How a row is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Maker {
    /// `dvr train --method METHOD --supervision WHAT`.
    Training(&'static str, Supervision),
    /// The same with `--encoder KIND`, which it needs whatever the others have.
    WithEncoder(&'static str, Supervision, &'static str),
    /// `dvr eval --baseline NAME`.
    Baseline(&'static str),
}

impl Maker {
    /// Method, supervision and, where it is not the method's own, encoder of a training.
    pub const fn training(self) -> Option<(&'static str, Supervision, Option<&'static str>)> {
        match self {
            Self::Training(method, supervision) => Some((method, supervision, None)),
            Self::WithEncoder(method, supervision, encoder) => Some((method, supervision, Some(encoder))),
            Self::Baseline(_) => None,
        }
    }
}

/// A row.
#[derive(Debug)]
pub struct System {
    /// Its name on the command line, and of its folders.
    pub row: &'static str,
    /// What it is, for people.
    pub title: &'static str,
    pub group: Group,
    pub maker: Maker,
    /// CPU seconds of a step at the default size, on a virtual AMD EPYC; of a baseline, of all.
    pub seconds: f64,
    /// The published mean Chamfer-L1 (times 10) of ShapeNet's thirteen categories, and where it is printed.
    pub published: Option<(f64, Source)>,
}

/// Where a figure is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Niemeyer et al. 2020, Differentiable Volumetric Rendering, table 1.
    Dvr,
    /// The same, mean of airplanes, cars and chairs, which are all that is printed.
    DvrThree,
}

impl Source {
    /// The mark behind a figure.
    pub const fn mark(self) -> &'static str {
        match self {
            Self::Dvr => "",
            Self::DvrThree => " (a)",
        }
    }
}

/// What the marks say.
pub const SOURCES: &str = "Published: mean Chamfer-L1 of ShapeNet's thirteen categories, Niemeyer et al. 2020, table 1, which has neither \
PSGN nor AtlasNet; (a) of its three categories airplane, car and chair. What \
Pixel2Mesh has there could not be looked up. It and rows with features of places know the camera of the picture, and these its \
mask, too, whose silhouette their shapes have; the others know neither.";

use Group::{DepthMaps, Lookup, Pictures, Shapes};
use Maker::{Baseline, Training, WithEncoder};

/// All rows, in the order of the table.
#[rustfmt::skip]
pub static SYSTEMS: &[System] = &[
    System { row: "drc", title: "DRC (Tulsiani et al. 2017), masks", group: Pictures, maker: Training("drc", Supervision::Rgb), seconds: 0.4, published: Some((0.553, Source::DvrThree)) },
    System { row: "softras", title: "SoftRas (Liu et al. 2019)", group: Pictures, maker: Training("softras", Supervision::Rgb), seconds: 0.2, published: Some((0.266, Source::Dvr)) },
    System { row: "dvr", title: "DVR", group: Pictures, maker: Training("objects", Supervision::Rgb), seconds: 0.25, published: Some((0.239, Source::Dvr)) },
    System { row: "dvr-local", title: "DVR, features of places in the picture", group: Pictures, maker: WithEncoder("objects", Supervision::Rgb, "local"), seconds: 0.5, published: None },
    System { row: "drc-depth", title: "DRC (Tulsiani et al. 2017), depth", group: DepthMaps, maker: Training("drc", Supervision::Depth), seconds: 0.4, published: Some((0.401, Source::DvrThree)) },
    System { row: "dvr-depth", title: "DVR, depth", group: DepthMaps, maker: Training("objects", Supervision::Depth), seconds: 0.15, published: Some((0.206, Source::Dvr)) },
    System { row: "dvr-local-depth", title: "DVR, features of places, depth", group: DepthMaps, maker: WithEncoder("objects", Supervision::Depth, "local"), seconds: 0.4, published: None },
    System { row: "dvr-rgb-depth", title: "DVR, pictures and depth", group: DepthMaps, maker: Training("objects", Supervision::RgbDepth), seconds: 0.15, published: None },
    System { row: "r2n2", title: "3D-R2N2 (Choy et al. 2016)", group: Shapes, maker: Training("r2n2", Supervision::Occupancy), seconds: 0.4, published: Some((0.277, Source::Dvr)) },
    System { row: "psgn", title: "PSGN (Fan et al. 2017)", group: Shapes, maker: Training("psgn", Supervision::Occupancy), seconds: 0.2, published: None },
    System { row: "atlasnet", title: "AtlasNet (Groueix et al. 2018)", group: Shapes, maker: Training("atlasnet", Supervision::Occupancy), seconds: 0.2, published: None },
    System { row: "pixel2mesh", title: "Pixel2Mesh (Wang et al. 2018)", group: Shapes, maker: WithEncoder("pixel2mesh", Supervision::Occupancy, "local"), seconds: 0.7, published: None },
    System { row: "onet", title: "Occupancy Networks (Mescheder et al. 2019)", group: Shapes, maker: Training("onet", Supervision::Occupancy), seconds: 0.26, published: Some((0.215, Source::Dvr)) },
    System { row: "mean-shape", title: "mean shape of the category", group: Lookup, maker: Baseline("mean-shape"), seconds: 10.0, published: None },
    System { row: "nearest-picture", title: "training object with the nearest picture", group: Lookup, maker: Baseline("nearest-picture"), seconds: 10.0, published: None },
];

#[cfg(test)]
mod tests {
    use dvr_train::method_by_name;
    use serde_json::json;

    use super::*;

    #[test]
    fn every_row_can_be_trained() {
        for system in SYSTEMS {
            if let Some((method, supervision, encoder)) = system.maker.training() {
                let mut method = method_by_name(method, supervision).unwrap();
                if let Some(kind) = encoder {
                    method = method.overridden(&json!({"encoder": {"kind": kind}})).unwrap();
                }
                method.check().unwrap();
                assert!(method.objects().is_some(), "{}", system.row);
            }
        }
    }
}
