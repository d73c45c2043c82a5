//! A compact field: occupancy and colour interpolated between the nodes of two grids.

mod exact_marcher;
pub mod file;
#[cfg(feature = "gpu")]
mod gpu;
pub(crate) mod grid_field;
mod tensors;

#[cfg(feature = "gpu")]
pub use gpu::GpuGridField;
pub use grid_field::{GridField, GridValues};
