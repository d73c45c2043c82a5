//! One difficulty at a time, as data.

use dvr_core::mesh::{Mesh, TexturedMesh};
use dvr_core::synth::SynthConfig;
use serde::{Deserialize, Serialize};

use crate::faults::Faults;
use crate::gradients::GradientTest;

/// What an axis makes difficult.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// The object's shape.
    Shape,
    /// Its texture.
    Texture,
    /// How many views there are, and from where.
    Views,
    /// Errors of the masks.
    Masks,
    /// Errors of the cameras.
    Cameras,
    /// Errors of the photographs.
    Pictures,
    /// The gradient of the depth itself.
    Gradients,
}

/// What is done at each difficulty.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A scene is reconstructed.
    Scene(fn(f64) -> Case),
    /// A figure of the depth's gradient is computed.
    Gradient(GradientTest),
}

/// A difficulty that grows, everything else being easy.
#[derive(Clone, Debug)]
pub struct Axis {
    /// Its name on the command line, in files and tables.
    pub name: &'static str,
    /// What it belongs to.
    pub group: Group,
    /// What a difficulty counts.
    pub unit: &'static str,
    /// What is there to see, in a sentence.
    pub what: &'static str,
    /// From easy to hard.
    pub difficulties: &'static [f64],
    /// Those of the quick set, from easy to hard.
    pub quick: &'static [f64],
    /// What is done.
    pub kind: Kind,
}

impl Axis {
    /// The scene of a difficulty; `None` where there is none to reconstruct.
    pub fn case(&self, difficulty: f64) -> Option<Case> {
        match self.kind {
            Kind::Scene(case) => Some(case(difficulty)),
            Kind::Gradient(_) => None,
        }
    }

    /// A difficulty as tables and file names have it.
    pub fn label(difficulty: f64) -> String {
        format!("{difficulty}")
    }
}

/// A scene that can be rendered, with what must be true of its reconstruction.
#[derive(Clone, Debug)]
pub struct Case {
    /// The true object, in object space: within the unit cube, around the origin.
    pub object: TexturedMesh,
    /// How it is photographed.
    pub config: SynthConfig,
    /// What is wrong with the photographs.
    pub faults: Faults,
    /// The part of the object that the axis is about, where the rest would hide its loss.
    pub part: Option<Mesh>,
    /// Handles that the reconstruction must have, where the axis is about them.
    pub handles: Option<i64>,
}

/// Pixels along the sides of a picture.
pub(crate) const PIXELS: u32 = 64;

impl Case {
    /// An object under the usual 24 views of 64 pixels, without faults.
    pub fn of(object: TexturedMesh) -> Self {
        let config = SynthConfig {
            width: PIXELS,
            height: PIXELS,
            depth_maps: false,
            // The truth is measured against here, and does not lie beside the pictures.
            surface_points: 0,
            occupancy_points: 0,
            ..SynthConfig::default()
        };
        Self { object, config, faults: Faults::default(), part: None, handles: None }
    }

    /// Edge of a pixel at the object's distance, object units.
    pub fn footprint(&self) -> f64 {
        footprint(&self.config)
    }
}

fn footprint(config: &SynthConfig) -> f64 {
    config.distance / (0.5 * config.focal * f64::from(config.width.min(config.height)))
}

/// [`Case::footprint`] of the usual views: generators make parts of so many of these.
pub(crate) fn usual_footprint() -> f64 {
    footprint(&SynthConfig { width: PIXELS, height: PIXELS, ..SynthConfig::default() })
}
