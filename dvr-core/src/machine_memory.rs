//! How much memory there still is.

/// Bytes that a process may still take without another being pushed out: what the system calls available, or less where
/// the process is in a control group with a limit. `None` where the system does not tell (anything but Linux).
pub fn available_memory() -> Option<u64> {
    let system = kilobytes(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")?;
    Some(of_control_group().map_or(system, |left| system.min(left)))
}

/// A number of a file of lines `NAME: NUMBER kB`, in bytes.
fn kilobytes(text: &str, name: &str) -> Option<u64> {
    let number = text.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next())?;
    number.parse::<u64>().ok()?.checked_mul(1024)
}

/// What is left of the limit of the control group (version 2) that a container runs in.
fn of_control_group() -> Option<u64> {
    let number = |file: &str| -> Option<u64> {
        std::fs::read_to_string(format!("/sys/fs/cgroup/{file}")).ok()?.trim().parse().ok()
    };
    // "max", which is no number, is no limit.
    Some(number("memory.max")?.saturating_sub(number("memory.current")?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_says_is_read_in_kilobytes() {
        let text = "MemTotal:       24576 kB\nMemAvailable:   12288 kB\n";
        assert_eq!(kilobytes(text, "MemAvailable:"), Some(12 << 20));
        assert_eq!(kilobytes("MemAvailable: much kB", "MemAvailable:"), None);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn there_is_some_on_this_machine() {
        assert!(available_memory().is_some_and(|bytes| bytes > 1 << 20));
    }
}
