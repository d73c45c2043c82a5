//! Sparse storage: numbers of nodes in bricks, allocated where the surface is or may come to be.
//!
//! A brick is a cube of [`EDGE`] nodes along each edge. Of its rows along x, those are stored that hold a node which is
//! asked for: a row of eight numbers is what processors move at once, and a band of seven nodes around a surface fills
//! rows better than whole bricks.

mod band;
mod layout;
mod node_set;
mod occupancy;
mod values;

pub(crate) use band::near_refined_surface;
pub(crate) use layout::{Brick, BrickLayout, EDGE, ROWS, Row, Stored};
pub(crate) use node_set::{BEFORE, NodeSet};
pub(crate) use occupancy::BrickOccupancy;
pub(crate) use values::BrickValues;
