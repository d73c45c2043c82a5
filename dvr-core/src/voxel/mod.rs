//! Voxel grids: nodes on a cube with trilinear interpolation between them, and the cells that a ray passes through.

mod grid;
mod traversal;

pub use grid::{Cell, VoxelGrid};
pub use traversal::{Segment, VoxelTraversal};
