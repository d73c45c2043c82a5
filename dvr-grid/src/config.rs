//! The settings of the grid method.

use dvr_core::number_range::{OutOfRange, check_config};
use dvr_core::{HOLD_OUT_EVERY, Supervision};
use serde::{Deserialize, Serialize};

use crate::config_ranges::MAX_CELLS;
use crate::error::Result;
use crate::losses::{ColorLoss, DepthLoss, DetachedColorLoss, GridLosses, PatchNccLoss, PhotoConsistencyLoss};

/// Pixels of the object up to which a step takes `rays`: 24 views of 128x128. Each is drawn some ten times in a stage.
const FEW_PIXELS: f64 = 125_000.0;

/// Everything that determines a run of the grid method besides the scene. Lengths are in units of the object cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridConfig {
    /// Which measurements the shape learns from.
    pub supervision: Supervision,
    /// Seed of all random choices.
    pub seed: u64,
    /// How fine the field may become.
    pub capacity: Capacity,
    /// Cells along an edge of the shape grid in the first stage; each stage has twice those of the one before.
    pub first_cells: usize,
    /// Cells along an edge up to which everything in the visual hull learns: concavities lie deep inside. In finer stages
    /// the surface is known well enough that only what is near it learns.
    pub whole_cells: usize,
    /// The compact field may not take more bytes than this; 0 for no limit.
    pub max_bytes: usize,
    /// Steps of each stage.
    pub steps: usize,
    /// Passes of as many steps that follow at most at the size that is kept, while the NCC of validation photographs gains;
    /// none where raw colours count in full, or nothing judges.
    pub further_passes: usize,
    /// Gain in NCC score of a stage or pass from which on a further pass follows. Of those that followed less on
    /// photographs and photoreal renders, none brought more than .0008; those that followed more, from .0011
    /// on, brought up to .011.
    pub further_after_gain: f64,
    /// Rays per step, where the object has up to 125 000 pixels in all photographs together.
    pub rays: usize,
    /// Most rays per step: they grow with the square root of the pixels.
    pub max_rays: usize,
    /// The terms of the loss.
    pub losses: GridLosses,
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
    /// Cells along an edge of the coarsest grid.
    pub coarsest_cells: usize,
    /// Cells of shape along the edge of a cell of colour. Fine colour explains the pictures on a wrong surface.
    pub color_coarseness: usize,
    /// Other views that a hit is compared with, for the photo-consistency and the patch NCC.
    pub compared_views: usize,
    /// Views among which those are drawn, nearest first.
    pub neighbours: usize,
    /// Pixels whose depth is looked for all along their way through the hull before training; 0 starts from the hull
    /// as it is. Finds the insides of bowls, which lie too far behind the hull for gradients.
    pub plane_sweep_pixels: usize,
    /// Cells along an edge of the distance field that stereo fuses before training; 0 starts without, and so does what shines while
    /// [`Self::trusts_colors`] is [`ColorTrust::Measured`].
    pub stereo_cells: usize,
    /// How far raw colours may shape the surface.
    pub trusts_colors: ColorTrust,
    /// Whether photographs may differ in exposure and white balance.
    pub exposure: ExposureCorrection,
    /// Views that may be wrong about the hull.
    pub disagreeing_views: DisagreeingViews,
    /// One view of this many is for testing, and one of twice as many for validation, where the dataset does not say
    /// ([`dvr_core::Scene::hold_out`]); 0 trains on all.
    pub hold_out_every: usize,
}

/// How fine the field may become.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Capacity {
    /// Twice the cells again while the NCC of validation photographs with training photographs gains, or is no worse and
    /// their PSNR gains, and cells are larger than half the footprint of a pixel; at most `max_cells`. Where these photographs
    /// are plain, PSNR alone decides; where views hardly agree on colours, nothing is taken back.
    Auto {
        /// Cells along an edge up to which growth is never taken back: the PSNR of a few views is too noisy.
        min_cells: usize,
        /// Most cells along an edge.
        max_cells: usize,
        /// Gain in NCC score below which growth is taken back that pictures do not gain by either, in standard errors of that
        /// gain.
        min_gain_errors: f64,
        /// Gain in PSNR on validation views from which on growth is kept where the NCC is no worse, or is not known, dB.
        min_gain_db: f64,
    },
    /// This many cells along an edge, whatever it brings.
    Cells(usize),
}

/// How far terms that compare raw colours may shape the surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorTrust {
    /// As far as views agree on colours, measured while the surface is learned: not on what shines, or changes its light.
    Measured,
    /// In full.
    Full,
}

/// Whether photographs may differ in exposure and white balance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureCorrection {
    /// Where factors of the light make views agree, they are solved for and corrected.
    Auto,
    /// They do not: colours are taken as they are.
    Off,
}

/// How many masks may be wrong at a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DisagreeingViews {
    /// One in twenty, of the views that are left when those are taken out whose masks show something else.
    Auto,
    /// One in this many.
    OneIn(usize),
    /// This many.
    Exactly(usize),
}

impl DisagreeingViews {
    /// The number, of this many views.
    pub fn of(self, views: usize) -> usize {
        match self {
            Self::Auto => views / 20,
            Self::OneIn(n) => views / n.max(1),
            Self::Exactly(n) => n,
        }
    }
}

impl Default for GridConfig {
    fn default() -> Self {
        Self::new(Supervision::Rgb)
    }
}

impl GridConfig {
    /// The defaults for a kind of supervision.
    pub fn new(supervision: Supervision) -> Self {
        let losses = match supervision {
            Supervision::Rgb | Supervision::Occupancy => GridLosses::default(),
            // The surface learns from the depth maps alone.
            Supervision::Depth => GridLosses {
                color: ColorLoss { weight: 0.0 },
                detached_color: DetachedColorLoss { weight: 1.0 },
                photo_consistency: PhotoConsistencyLoss { weight: 0.0, ..PhotoConsistencyLoss::default() },
                patch_ncc: PatchNccLoss { weight: 0.0, ..PatchNccLoss::default() },
                depth: DepthLoss { weight: 10.0 },
                ..GridLosses::default()
            },
            Supervision::RgbDepth => GridLosses { depth: DepthLoss { weight: 10.0 }, ..GridLosses::default() },
        };
        Self {
            supervision,
            seed: 0,
            capacity: Capacity::Auto { min_cells: 64, max_cells: 256, min_gain_errors: 2.0, min_gain_db: 0.1 },
            first_cells: 32,
            whole_cells: 128,
            max_bytes: 0,
            steps: 300,
            further_passes: 3,
            further_after_gain: 0.0008,
            rays: 2048,
            max_rays: 8192,
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
            plane_sweep_pixels: 250_000,
            stereo_cells: 128,
            trusts_colors: ColorTrust::Measured,
            exposure: ExposureCorrection::Auto,
            disagreeing_views: DisagreeingViews::Auto,
            hold_out_every: HOLD_OUT_EVERY,
        }
    }

    /// Rays per step where the object has this many pixels in all photographs together.
    pub(crate) fn rays_of(&self, pixels: usize) -> usize {
        let factor = (pixels as f64 / FEW_PIXELS).sqrt().max(1.0);
        ((self.rays as f64 * factor) as usize).clamp(self.rays, self.max_rays.max(self.rays))
    }

    /// Most cells along an edge that the capacity allows.
    pub fn last_cells(&self) -> usize {
        match self.capacity {
            Capacity::Auto { max_cells, .. } => max_cells,
            Capacity::Cells(cells) => cells,
        }
    }

    /// The visual hull and nothing else: what masks and cameras alone tell. The baseline of every comparison.
    pub fn hull() -> Self {
        Self {
            steps: 0,
            capacity: Capacity::Cells(128),
            first_cells: 128,
            disagreeing_views: DisagreeingViews::Exactly(0),
            ..Self::new(Supervision::Rgb)
        }
    }

    /// Checks that the values make sense together.
    ///
    /// # Errors
    /// Names the key, the value and the range.
    pub fn check(&self) -> Result<()> {
        check_config(self, &Self::ranges())?;
        self.check_grids()
    }

    /// Checks that the grids fit into each other.
    fn check_grids(&self) -> Result<()> {
        let is_doubled = |cells: usize, first: usize| {
            cells >= first && cells.is_multiple_of(first) && (cells / first).is_power_of_two() && cells <= MAX_CELLS
        };
        if !is_doubled(self.first_cells, self.coarsest_cells) {
            let range = format!("coarsest_cells ({}) times a power of two, at most {MAX_CELLS}", self.coarsest_cells);
            return out_of_range("first_cells", self.first_cells, &range);
        }
        let last = self.last_cells();
        if !is_doubled(last.max(self.first_cells), self.first_cells) {
            let range = format!("first_cells ({}) times a power of two, at most {MAX_CELLS}", self.first_cells);
            return out_of_range("capacity", last, &range);
        }
        if !self.color_coarseness.is_power_of_two()
            || 2 * self.color_coarseness * self.coarsest_cells > self.first_cells
        {
            let range = "a power of two that leaves two levels of colour between coarsest_cells and first_cells";
            return out_of_range("color_coarseness", self.color_coarseness, range);
        }
        Ok(())
    }
}

fn out_of_range(key: &str, value: impl std::fmt::Display, range: &str) -> Result<()> {
    Err(OutOfRange::new(key, value, range).into())
}
