//! Voxel grids: nodes on a cube with trilinear interpolation between them, and the cells that a ray passes through.

mod grid;
mod least_area;
mod traversal;

pub use grid::{Cell, VoxelGrid};
pub use least_area::least_area;
pub use traversal::{Segment, VoxelTraversal};
