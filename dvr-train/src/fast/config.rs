//! The settings of the fast method.

use serde::{Deserialize, Serialize};

use crate::config::Supervision;
use crate::error::{Error, Result};

/// Everything that determines a fast run besides the scene. Lengths are in units of the object cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastConfig {
    /// Which measurements teach the shape.
    pub supervision: Supervision,
    /// Seed of all random choices.
    pub seed: u64,
    /// Cells along an edge of the shape lattice, stage after stage; each twice the one before.
    pub cells: Vec<usize>,
    /// Steps of each stage.
    pub steps: Vec<usize>,
    /// Rays a step.
    pub rays: usize,
    /// Weights of the losses.
    pub losses: FastLosses,
    /// Adam's step size for the coarsest shape level, in object units.
    pub shape_rate: f64,
    /// Factor of the step size from a shape level to the next finer one.
    pub shape_rate_ratio: f64,
    /// Adam's step size for the coarsest colour level.
    pub color_rate: f64,
    /// Factor of the step size from a colour level to the next finer one.
    pub color_rate_ratio: f64,
    /// What step sizes have fallen to at the end of a run, as a share.
    pub final_rate: f64,
    /// Cells along an edge of the coarsest lattice.
    pub coarsest_cells: usize,
    /// Cells of shape along the edge of a cell of colour. Fine colour explains the pictures on a wrong surface.
    pub color_coarseness: usize,
    /// Cross-view colour: other views that a hit is compared with.
    pub compared_views: usize,
    /// Views among which those are drawn, nearest first.
    pub neighbours: usize,
    /// Views that may be wrong about the hull.
    pub disagreeing_views: DisagreeingViews,
    /// One view in so many is held out, where the dataset does not say.
    pub hold_out_every: usize,
}

/// How many masks need not be believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DisagreeingViews {
    /// One in so many.
    OneIn(usize),
    /// So many.
    Exactly(usize),
}

impl DisagreeingViews {
    /// The number, of so many views.
    pub fn of(self, views: usize) -> usize {
        match self {
            Self::OneIn(n) => views / n.max(1),
            Self::Exactly(n) => n,
        }
    }
}

/// Weights of the fast method's losses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FastLosses {
    /// Colour of hits against their pixels, L1.
    pub color: f64,
    /// Colour of the pixel against other views' pictures at the hit, L1: what makes the surface right where it has texture.
    pub cross_view: f64,
    /// Cross-view residuals above this are taken for occlusion or highlights, and ignored.
    pub cross_view_limit: f64,
    /// Depth of hits against depth maps, L1.
    pub depth: f64,
    /// Free space on background rays and occupancy on object rays that miss.
    pub mask: f64,
    /// How steep the logistic function of these is: logits are so many times the shape's values.
    pub sharpness: f64,
    /// How far the gradient's length at hits is from one, squared.
    pub eikonal: f64,
    /// Roughness: how far a node near the surface is from the mean of its neighbours.
    pub laplacian: f64,
}

impl Default for FastLosses {
    fn default() -> Self {
        Self {
            color: 1.0,
            cross_view: 10.0,
            cross_view_limit: 0.5,
            depth: 0.0,
            mask: 1.0,
            sharpness: 100.0,
            eikonal: 0.05,
            laplacian: 0.0,
        }
    }
}

impl Default for FastConfig {
    fn default() -> Self {
        Self::new(Supervision::Rgb)
    }
}

impl FastConfig {
    /// The defaults for a kind of supervision.
    pub fn new(supervision: Supervision) -> Self {
        let losses = match supervision {
            Supervision::Rgb => FastLosses::default(),
            Supervision::Depth => FastLosses { cross_view: 0.0, depth: 10.0, ..FastLosses::default() },
            Supervision::RgbDepth => FastLosses { depth: 10.0, ..FastLosses::default() },
        };
        Self {
            supervision,
            seed: 0,
            cells: vec![64],
            steps: vec![300],
            rays: 2048,
            losses,
            shape_rate: 6e-3,
            shape_rate_ratio: 0.35,
            color_rate: 2e-2,
            color_rate_ratio: 0.7,
            final_rate: 0.05,
            coarsest_cells: 8,
            color_coarseness: 2,
            compared_views: 2,
            neighbours: 6,
            disagreeing_views: DisagreeingViews::OneIn(20),
            hold_out_every: 8,
        }
    }

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        let fail = |key: &str, value: String, range: &str| {
            Err(Error::Config(format!("`{key}` is {value}, it must be {range}")))
        };
        let doubling = self.cells.windows(2).all(|pair| pair[1] == 2 * pair[0]);
        let halves_to_coarsest = |cells: usize| {
            let factor = cells / self.coarsest_cells.max(1);
            factor * self.coarsest_cells == cells && factor.is_power_of_two()
        };
        if self.cells.is_empty()
            || !doubling
            || !self.cells.iter().all(|&cells| halves_to_coarsest(cells) && cells <= 512)
        {
            return fail(
                "cells",
                format!("{:?}", self.cells),
                "a list, each twice the one before, coarsest_cells times a power of two, at most 512",
            );
        }
        if self.steps.len() != self.cells.len() {
            return fail("steps", format!("{:?}", self.steps), "as long as `cells`");
        }
        if !self.color_coarseness.is_power_of_two() || self.color_coarseness > self.cells[0] / self.coarsest_cells {
            return fail(
                "color_coarseness",
                self.color_coarseness.to_string(),
                "a power of two, at most cells / coarsest_cells",
            );
        }
        if self.rays == 0 {
            return fail("rays", "0".into(), "at least 1");
        }
        let losses = &self.losses;
        let numbers = [
            ("losses.color", losses.color),
            ("losses.cross_view", losses.cross_view),
            ("losses.cross_view_limit", losses.cross_view_limit),
            ("losses.depth", losses.depth),
            ("losses.mask", losses.mask),
            ("losses.sharpness", losses.sharpness),
            ("losses.eikonal", losses.eikonal),
            ("losses.laplacian", losses.laplacian),
            ("shape_rate", self.shape_rate),
            ("shape_rate_ratio", self.shape_rate_ratio),
            ("color_rate", self.color_rate),
            ("color_rate_ratio", self.color_rate_ratio),
            ("final_rate", self.final_rate),
        ];
        match numbers.into_iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
            Some((name, value)) => fail(name, value.to_string(), "zero or positive"),
            None => Ok(()),
        }
    }
}
