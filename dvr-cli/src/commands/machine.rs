//! The machine and the program that made results.

use std::fmt;

use serde::{Deserialize, Serialize};

/// Machine and program, as results store them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// The CPU.
    pub cpu: String,
    /// Threads that the program used.
    pub threads: usize,
    /// The program's version and commit.
    pub program: String,
}

impl Machine {
    /// This machine and this program.
    pub fn this() -> Self {
        let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model =
            info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
        Self {
            cpu: model.unwrap_or(std::env::consts::ARCH).to_owned(),
            threads: rayon::current_num_threads(),
            program: format!("dvr {} ({})", env!("CARGO_PKG_VERSION"), env!("DVR_COMMIT")),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {} threads, {}", self.cpu, self.threads, self.program)
    }
}
