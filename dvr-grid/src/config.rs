//! The settings of the fast method.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use dvr_core::Supervision;

/// Most cells along an edge: two gigabytes of nodes.
const MAX_CELLS: usize = 512;

/// Everything that determines a fast run besides the scene. Lengths are in units of the object cube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridConfig {
    /// Which measurements teach the shape.
    pub supervision: Supervision,
    /// Seed of all random choices.
    pub seed: u64,
    /// How fine the field may become.
    pub capacity: Capacity,
    /// Cells along an edge of the shape grid in the first stage; each stage has twice those of the one before.
    pub first_cells: usize,
    /// Cells along an edge up to which everything in the visual hull is taught: concavities lie deep inside. In finer
    /// stages the surface is known well enough to teach what is near it alone.
    pub whole_cells: usize,
    /// The compact field may not take more bytes than this; 0 for no limit.
    pub max_bytes: usize,
    /// Steps of each stage.
    pub steps: usize,
    /// Rays a step.
    pub rays: usize,
    /// Weights of the losses.
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
    /// Cross-view colour: other views that a hit is compared with.
    pub compared_views: usize,
    /// Views among which those are drawn, nearest first.
    pub neighbours: usize,
    /// Pixels whose depth is looked for all along their way through the hull before training; 0 starts from the hull
    /// as it is. Finds the insides of bowls, which lie too far behind the hull for gradients.
    pub plane_sweep_pixels: usize,
    /// Views that may be wrong about the hull.
    pub disagreeing_views: DisagreeingViews,
    /// One view in so many is held out, where the dataset does not say.
    pub hold_out_every: usize,
}

/// How fine the field may become.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Capacity {
    /// Twice the cells again while that makes held-out views better by at least `min_gain_db`, and cells are larger
    /// than half the footprint of a pixel; at most `max_cells`.
    Auto {
        /// Cells along an edge up to which growth is never taken back: a few held-out views are too noisy a judge.
        min_cells: usize,
        /// Most cells along an edge.
        max_cells: usize,
        /// Gain in PSNR on held-out views below which growth is taken back, dB.
        min_gain_db: f64,
    },
    /// So many cells along an edge, whatever it brings.
    Cells(usize),
}

/// How many masks need not be believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DisagreeingViews {
    /// One in twenty, of the views that are left when those are taken out whose masks show something else.
    Auto,
    /// One in so many.
    OneIn(usize),
    /// So many.
    Exactly(usize),
}

impl DisagreeingViews {
    /// The number, of so many views.
    pub fn of(self, views: usize) -> usize {
        match self {
            Self::Auto => views / 20,
            Self::OneIn(n) => views / n.max(1),
            Self::Exactly(n) => n,
        }
    }
}

/// Weights of the fast method's losses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GridLosses {
    /// Colour of hits against their pixels, L1. Its gradient shapes the surface.
    pub color: f64,
    /// The same with the surface held still: teaches the colour alone.
    pub texture: f64,
    /// Colour of the pixel against other views' pictures at the hit, L1: what makes the surface right where it has
    /// texture.
    pub photo_consistency: f64,
    /// Cross-view residuals above this are taken for occlusion or highlights, and ignored.
    pub photo_consistency_limit: f64,
    /// Cross-view structure: one less the normalised cross-correlation of a patch around the pixel with its projection,
    /// by the plane of the surface, to other views. Blind to exposure and to what has no texture.
    pub patch_ncc: f64,
    /// Structures less correlated than this are taken for occlusion, and ignored.
    pub patch_ncc_min: f64,
    /// Pixels between the samples of a patch of 3x3.
    pub patch_stride: u32,
    /// Depth of hits against depth maps, L1.
    pub depth: f64,
    /// Free space on background rays and occupancy on object rays that miss.
    pub mask: f64,
    /// How steep the logistic function of these is: logits are so many times the shape's values.
    pub sharpness: f64,
    /// LaplacianSmoothness: how far, in cells, a node near the surface is from the mean of its neighbours; see `smoothness_knee`.
    pub smoothness: f64,
    /// LaplacianSmoothness counts in square up to this and linearly beyond: noise is smoothed, edges stay.
    pub smoothness_knee: f64,
}

impl Default for GridLosses {
    fn default() -> Self {
        Self {
            color: 1.0,
            texture: 0.0,
            photo_consistency: 10.0,
            photo_consistency_limit: 0.1,
            patch_ncc: 1.0,
            patch_ncc_min: 0.3,
            patch_stride: 1,
            depth: 0.0,
            mask: 10.0,
            sharpness: 100.0,
            smoothness: 3.0,
            smoothness_knee: 0.05,
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
            // The surface is the depth maps' business alone.
            Supervision::Depth => GridLosses {
                color: 0.0,
                texture: 1.0,
                photo_consistency: 0.0,
                patch_ncc: 0.0,
                depth: 10.0,
                ..GridLosses::default()
            },
            Supervision::RgbDepth => GridLosses { depth: 10.0, ..GridLosses::default() },
        };
        Self {
            supervision,
            seed: 0,
            capacity: Capacity::Auto { min_cells: 64, max_cells: 256, min_gain_db: 0.1 },
            first_cells: 32,
            whole_cells: 128,
            max_bytes: 0,
            steps: 300,
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
            plane_sweep_pixels: 15_000,
            disagreeing_views: DisagreeingViews::Auto,
            hold_out_every: 8,
        }
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
        let fail =
            |key: &'static str, value: String, range: &str| Err(Error::OutOfRange { key, value, range: range.into() });
        let is_doubled = |cells: usize, first: usize| {
            first > 0
                && cells >= first
                && cells.is_multiple_of(first)
                && (cells / first).is_power_of_two()
                && cells <= MAX_CELLS
        };
        if self.coarsest_cells == 0 || !is_doubled(self.first_cells, self.coarsest_cells) {
            let range = format!("coarsest_cells ({}) times a power of two, at most {MAX_CELLS}", self.coarsest_cells);
            return fail("first_cells", self.first_cells.to_string(), &range);
        }
        let last = self.last_cells();
        if !is_doubled(last.max(self.first_cells), self.first_cells) {
            let range = format!("first_cells ({}) times a power of two, at most {MAX_CELLS}", self.first_cells);
            return fail("capacity", last.to_string(), &range);
        }
        if !self.color_coarseness.is_power_of_two()
            || 2 * self.color_coarseness * self.coarsest_cells > self.first_cells
        {
            let range = "a power of two that leaves two levels of colour between coarsest_cells and first_cells";
            return fail("color_coarseness", self.color_coarseness.to_string(), range);
        }
        if self.rays == 0 || self.compared_views == 0 {
            return fail("rays or compared_views", "0".into(), "at least 1");
        }
        let losses = &self.losses;
        let numbers = [
            ("losses.color", losses.color),
            ("losses.texture", losses.texture),
            ("losses.photo_consistency", losses.photo_consistency),
            ("losses.photo_consistency_limit", losses.photo_consistency_limit),
            ("losses.patch_ncc", losses.patch_ncc),
            ("losses.depth", losses.depth),
            ("losses.mask", losses.mask),
            ("losses.sharpness", losses.sharpness),
            ("losses.smoothness", losses.smoothness),
            ("losses.smoothness_knee", losses.smoothness_knee),
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
