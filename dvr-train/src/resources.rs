//! What this process has cost so far.

use serde::{Deserialize, Serialize};

/// Time and memory of a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Resources {
    /// Seconds of all CPU cores together.
    pub cpu_seconds: f64,
    /// The most memory it held at a time, in bytes, where the system tells (Linux).
    pub peak_memory: Option<u64>,
}

impl Resources {
    /// Of this process, from its start until now.
    pub fn now() -> Self {
        let cpu_seconds = cpu_time::ProcessTime::try_now().map_or(0.0, |time| time.as_duration().as_secs_f64());
        // VmHWM of proc_pid_status(5): the peak resident set size, in kB.
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next()?.parse().ok());
        Self { cpu_seconds, peak_memory: peak.map(|kilobytes: u64| 1024 * kilobytes) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_and_memory_are_noticed() {
        let before = Resources::now();
        let memory = vec![1u8; 64 << 20];
        let sum: u64 = (0..20).flat_map(|_| &memory).map(|&b| u64::from(b)).sum();
        let after = Resources::now();
        assert!(sum > 0 && after.cpu_seconds > before.cpu_seconds);
        if let (Some(before), Some(after)) = (before.peak_memory, after.peak_memory) {
            assert!(after >= before && after >= 64 << 20);
        }
    }
}
