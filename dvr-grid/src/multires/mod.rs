//! Nested grids from coarse to fine: their levels, what goes between them, and the optimiser that moves them.

mod adam;
mod grids;
mod levels;
mod pyramid;

pub(crate) use grids::{ColorGrid, Grids, ShapeGrid};
pub(crate) use levels::{MultiResGrid, prolonged};
pub(crate) use pyramid::prolong_add;
