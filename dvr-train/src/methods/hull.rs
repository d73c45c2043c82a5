//! The visual hull of the masks, coloured by the photographs: what can be had without any training.

use dvr_core::Supervision;
use dvr_grid::GridConfig;

use crate::methods::grid::GridMethod;

/// The method. It learns from masks alone, whatever the supervision.
pub fn hull(_: Supervision) -> GridMethod {
    GridMethod::named("hull", GridConfig::hull())
}
