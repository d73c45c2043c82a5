//! What made the figures.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Machine and program.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The processor.
    pub processor: String,
    /// Threads that the program used.
    pub threads: usize,
    /// The program's version and commit.
    pub program: String,
}

impl Machine {
    /// This machine and this program.
    pub fn this() -> Self {
        let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model =
            cpu.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
        Self {
            processor: model.unwrap_or(std::env::consts::ARCH).to_owned(),
            threads: rayon::current_num_threads(),
            program: format!("dvr {} ({})", env!("CARGO_PKG_VERSION"), env!("DVR_COMMIT")),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {} threads, {}", self.processor, self.threads, self.program)
    }
}
