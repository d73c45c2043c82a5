//! The steps of a run: rays to gradients, gradients to parameters. On the CPU, or on a GPU that keeps the parameters.
//!
//! `cpu` and `gpu` hold the same files: `rays` (what a ray says of the field), `gather` (from points to nodes),
//! `smoothness`, `backend` (one after the other). What the levels do is in `multires` for the CPU and in `gpu::levels`
//! and `gpu::pyramid` for the GPU; the occupancy bitmask in `crate::occupancy` and `crate::gpu::occupancy`. Both are
//! [`StepBackend`]s and pass the tests of `suite`.

mod backend;
mod cpu;
pub(crate) mod draw;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(any(test, feature = "gpu"))]
mod record;
#[cfg(test)]
pub(crate) mod suite;

pub(crate) use backend::{REPORT_EVERY, StepBackend, StepInput};
pub(crate) use cpu::CpuBackend;
#[cfg(feature = "gpu")]
pub(crate) use gpu::GpuBackend;
