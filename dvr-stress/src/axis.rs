//! Axes of difficulty, and cases: one difficulty at a time.

use dvr_core::mesh::{Mesh, TexturedMesh};
use dvr_core::synth::SynthConfig;
use serde::{Deserialize, Serialize};

use crate::faults::Faults;
use crate::gradients::GradientTest;

/// What an axis varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// The object's shape.
    Shape,
    /// Its texture.
    Texture,
    /// Number and placement of views.
    Views,
    /// Errors of the masks.
    Masks,
    /// Errors of the cameras.
    Cameras,
    /// Errors of the photographs.
    Pictures,
    /// What photographs have and renders lack: gloss, plain areas, tints, narrow frames, views from a sector, many pixels.
    Photographs,
    /// The gradient of the depth.
    Gradients,
}

/// What is computed at each difficulty.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A scene is reconstructed.
    Scene(fn(f64) -> Case),
    /// An error of the depth's gradient is computed.
    Gradient(GradientTest),
}

/// A difficulty that grows while everything else is easy.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Its name on the command line, in files and tables.
    pub name: &'static str,
    /// Its group.
    pub group: Group,
    /// Unit of a difficulty.
    pub unit: &'static str,
    /// What the scene shows, in a phrase.
    pub what: &'static str,
    /// From easy to hard.
    pub difficulties: &'static [f64],
    /// The quick set, from easy to hard.
    pub quick: &'static [f64],
    /// What is computed.
    pub kind: Kind,
}

impl Axis {
    /// An axis of scenes with its name, its unit and what it shows.
    pub(crate) fn of_scenes(
        group: Group,
        [name, unit, what]: [&'static str; 3],
        difficulties: &'static [f64],
        quick: &'static [f64],
        case: fn(f64) -> Case,
    ) -> Self {
        Self { name, group, unit, what, difficulties, quick, kind: Kind::Scene(case) }
    }

    /// The scene of a difficulty; `None` for axes of gradients.
    pub fn case(&self, difficulty: f64) -> Option<Case> {
        match self.kind {
            Kind::Scene(case) => Some(case(difficulty)),
            Kind::Gradient(_) => None,
        }
    }

    /// A difficulty as text, for tables and file names.
    pub fn label(difficulty: f64) -> String {
        format!("{difficulty}")
    }
}

/// A scene to render, and conditions on its reconstruction.
#[derive(Clone, Debug)]
pub struct Case {
    /// The true object, in object space: within the unit cube, around the origin.
    pub object: TexturedMesh,
    /// How it is rendered.
    pub config: SynthConfig,
    /// Faults of masks and cameras.
    pub faults: Faults,
    /// A part of the object that must be there, where the Chamfer distance of the whole would hide its loss.
    pub part: Option<Mesh>,
    /// The number of handles that the reconstruction must have, where it matters.
    pub handles: Option<i64>,
}

/// Width and height of a picture, pixels.
pub(crate) const PIXELS: u32 = 64;

impl Case {
    /// An object under the usual 24 views of 64 pixels, without faults.
    pub fn of(object: TexturedMesh) -> Self {
        let config = SynthConfig {
            width: PIXELS,
            height: PIXELS,
            depth_maps: false,
            // The ground truth stays in memory and is not written beside the pictures.
            surface_points: 0,
            occupancy_points: 0,
            ..SynthConfig::default()
        };
        Self { object, config, faults: Faults::default(), part: None, handles: None }
    }

    /// A pixel's footprint: its edge at the object's distance, object units.
    pub fn footprint(&self) -> f64 {
        footprint(&self.config)
    }
}

fn footprint(config: &SynthConfig) -> f64 {
    config.distance / (0.5 * config.focal * f64::from(config.width.min(config.height)))
}

/// [`Case::footprint`] of the usual views, the unit of sizes in pixels.
pub(crate) fn usual_footprint() -> f64 {
    footprint(&SynthConfig { width: PIXELS, height: PIXELS, ..SynthConfig::default() })
}
