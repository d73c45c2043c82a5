//! What kernels share: grids and points, rays that pass through cells, the occupancy bitmask, photographs; and a
//! finished field that is rendered on a device.
//!
//! `dense` brings values in bricks there. Each other file is the counterpart of one for the CPU: `voxel` and `traversal`
//! of `dvr_core::voxel`, `cubic`, `occupancy` and `views` of the files of the same names in this crate. The kernels of a
//! step are in `step::gpu`.

pub(crate) mod cubic;
pub(crate) mod dense;
pub(crate) mod launch;
mod look;
pub(crate) mod occupancy;
pub(crate) mod traversal;
mod viewer;
pub(crate) mod views;
pub(crate) mod voxel;

pub use viewer::GpuGridView;
