//! Where a command computes, and how much memory it takes.

use clap::Args;

use super::values::parse_memory;
use crate::backend::{self, Backend};

/// Where the computation runs.
#[derive(Args, Clone, Copy, Debug)]
pub struct BackendArg {
    #[arg(long, value_name = "BACKEND", default_value_t = Backend::Cpu, help = backend::HELP)]
    pub backend: Backend,
}

/// Memory limit of commands that read a trained run.
#[derive(Args, Clone, Copy, Debug)]
pub struct MemoryArg {
    /// Memory limit, e.g. 500M or 2G. Decoded photographs beyond it are paged from a scratch file, and what would take more
    /// is refused. With --backend gpu it limits photographs, and the GPU memory of tensors: work is split to fit
    /// [0 to 1000000G; default: what the machine has]
    #[arg(long, value_parser = parse_memory, value_name = "BYTES")]
    pub memory: Option<u64>,
}
