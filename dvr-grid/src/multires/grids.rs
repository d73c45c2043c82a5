//! What a run learns: a shape grid and a colour grid.

use super::levels::MultiResGrid;
use crate::color::CHANNELS;
use crate::error::Result;
use crate::field::{GridField, GridValues, file};

/// The occupancy logit at the nodes, in units of length.
pub(crate) type ShapeGrid = MultiResGrid<1>;

/// What colour is evaluated from; see [`crate::color`].
pub(crate) type ColorGrid = MultiResGrid<CHANNELS>;

/// Everything that is learned.
#[derive(Clone, Debug)]
pub(crate) struct Grids {
    pub shape: ShapeGrid,
    pub color: ColorGrid,
}

impl Grids {
    /// Parameters of all levels.
    pub fn parameters(&self) -> usize {
        self.shape.parameters() + self.color.parameters()
    }

    /// Cells along an edge of the shape grid.
    pub fn cells(&self) -> usize {
        self.shape.grid().cells()
    }

    /// The field that they make.
    pub fn field(&self) -> GridField {
        GridField::new(
            GridValues { grid: *self.shape.grid(), values: self.shape.values().to_vec() },
            GridValues { grid: *self.color.grid(), values: self.color.values().to_vec() },
        )
    }

    /// The same as a checkpoint stores it.
    ///
    /// # Errors
    /// When it cannot be encoded.
    pub fn field_bytes(&self) -> Result<Vec<u8>> {
        Ok(file::to_bytes(&self.field())?)
    }
}
