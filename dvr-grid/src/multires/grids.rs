//! What a run learns: a shape grid and a colour grid.

use super::levels::MultiResGrid;
use crate::color::CHANNELS;
use crate::error::Result;
use crate::field::{GridField, file};

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
        GridField::of_bricks(self.shape.values().clone(), self.color.values().clone())
    }

    /// The same as a checkpoint stores it.
    ///
    /// # Errors
    /// When it cannot be encoded.
    pub fn field_bytes(&self) -> Result<Vec<u8>> {
        Ok(file::to_bytes(&self.field())?)
    }
}
