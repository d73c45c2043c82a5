//! The ranges of the numbers of a grid's configuration.

use dvr_core::number_range::{NumberRange, real, whole};

use crate::config::GridConfig;
use crate::losses::GridLosses;

/// Most cells along an edge: two gigabytes of nodes.
pub(crate) const MAX_CELLS: usize = 512;

const CELLS: u64 = MAX_CELLS as u64;

/// All numbers but those of the losses.
const RANGES: &[NumberRange] = &[
    whole("seed", 0, u64::MAX),
    whole("capacity.auto.min_cells", 0, CELLS),
    whole("capacity.auto.max_cells", 1, CELLS),
    real("capacity.auto.min_gain_errors", -1000.0, 1000.0),
    real("capacity.auto.min_gain_db", -100.0, 100.0),
    whole("capacity.cells", 1, CELLS),
    whole("first_cells", 1, CELLS),
    whole("whole_cells", 0, CELLS),
    whole("max_bytes", 0, 1 << 40),
    whole("steps", 0, 1_000_000_000),
    whole("further_passes", 0, 1000),
    real("further_after_gain", -1.0, 1.0),
    whole("rays", 1, 1 << 20),
    whole("max_rays", 1, 1 << 20),
    real("shape_rate", 0.0, 10.0),
    real("shape_rate_ratio", 0.0, 10.0),
    real("color_rate", 0.0, 10.0),
    real("color_rate_ratio", 0.0, 10.0),
    real("final_rate", 0.0, 1.0),
    whole("coarsest_cells", 1, CELLS),
    whole("color_coarseness", 1, CELLS),
    whole("compared_views", 1, 1000),
    whole("neighbours", 0, 1000),
    whole("plane_sweep_pixels", 0, 100_000_000),
    whole("stereo_cells", 0, CELLS / 2),
    whole("disagreeing_views.one-in", 1, 1_000_000),
    whole("disagreeing_views.exactly", 0, 1_000_000),
    whole("hold_out_every", 0, 1_000_000),
];

impl GridConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        RANGES.iter().cloned().chain(GridLosses::ranges()).collect()
    }
}
