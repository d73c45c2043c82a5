//! How good a result is: [`shape`] against the true surface and volume, [`picture`] against photographs.

pub mod alignment;
mod overlap;
pub mod picture;
pub mod shape;

pub use overlap::intersection_over_union;
