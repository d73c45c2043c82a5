//! The machine that made results.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A machine, as far as figures depend on it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Machine {
    /// Model of the CPU.
    pub cpu: String,
    /// Cores that the process may use.
    pub cores: usize,
    /// Threads that it uses.
    pub threads: usize,
    /// What computes: `cpu`, or a GPU with its name.
    pub device: String,
}

impl Machine {
    /// This machine, with what computes on it.
    pub fn this(device: impl Into<String>) -> Self {
        let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model =
            info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':').map(|(_, name)| name.trim()));
        Self {
            cpu: model.unwrap_or(std::env::consts::ARCH).to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            threads: rayon::current_num_threads(),
            device: device.into(),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cpu, cores, threads, device } = self;
        write!(f, "{cpu}, {cores} cores, {threads} threads")?;
        if device == "cpu" { Ok(()) } else { write!(f, ", {device}") }
    }
}
