//! Nested grids from coarse to fine: their levels, what goes between them, and the optimiser that moves them.

mod adam;
#[cfg(test)]
mod dense;
mod grids;
mod levels;
mod pyramid;
#[cfg(test)]
mod stages;

pub(crate) use grids::{ColorGrid, Grids, ShapeGrid};
#[cfg(any(test, feature = "gpu"))]
pub(crate) use levels::MultiResGrid;
