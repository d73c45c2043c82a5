//! Steps on a GPU: rays, gradients, Adam and the occupancy bitmask as kernels.
//!
//! What is learned stays on the device from step to step. A step is given its rays, some words each, and is waited for
//! only where its losses are asked for. Its results do not depend on the order in which work-items run: the same device
//! gives the same bits.

mod agreement;
mod backend;
mod gather;
mod kernels;
mod levels;
mod pyramid;
mod rays;
mod slope_rule;
mod smoothness;
mod stage;

pub(crate) use backend::GpuBackend;
