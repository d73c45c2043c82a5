//! Object and background learned together, as a field of opacity and colour: what is in the cube, before the plane that
//! the object stands on, is the object.

mod contracted_grid;
mod field;
mod fit;
mod masks;

pub(crate) use fit::{Fit, LEVELS};
pub(crate) use masks::LearnedMasks;

/// Bytes that learning takes at most, about.
pub(crate) const BYTES: u64 = fit::BYTES;
