//! Steps on the CPU.

mod backend;
mod gather;
mod rays;

pub(crate) use backend::CpuBackend;
