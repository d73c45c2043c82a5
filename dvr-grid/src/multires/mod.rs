//! Nested grids from coarse to fine: their levels, what goes between them, and the optimiser that moves them.

mod adam;
mod grids;
mod levels;
mod pyramid;

pub(crate) use grids::{ColorGrid, Grids, ShapeGrid};
#[cfg(feature = "gpu")]
pub(crate) use levels::MultiResGrid;
pub(crate) use levels::prolonged;
pub(crate) use pyramid::prolong_add;
