//! Programs whose threads wait for each other for good, as COLMAP's do at times when it has done its work.

use std::time::{Duration, Instant};

/// How long a program must be found so, each time that it is looked at.
const SURE_AFTER: Duration = Duration::from_secs(if cfg!(test) { 4 } else { 30 });

/// Interval of looking.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Watches a program that says nothing.
pub(crate) struct Watch {
    /// When it was looked at last.
    looked: Instant,
    /// Since when all its threads wait, and the processor time that they had used then.
    waiting: Option<(Instant, u64)>,
}

impl Watch {
    pub fn new() -> Self {
        Self { looked: Instant::now(), waiting: None }
    }

    /// It said something.
    pub fn heard(&mut self) {
        self.waiting = None;
    }

    /// Whether a group of processes is sure to do nothing any more. It is looked at every second, whenever this is asked.
    pub fn is_deadlocked(&mut self, group: u32) -> bool {
        if self.looked.elapsed() < LOOK_EVERY {
            return false;
        }
        self.looked = Instant::now();
        self.waiting = match (self.waiting, ticks_of_waiting(group)) {
            (Some((since, before)), Some(ticks)) if ticks == before => Some((since, ticks)),
            (_, now) => now.map(|ticks| (Instant::now(), ticks)),
        };
        self.waiting.is_some_and(|(since, _)| since.elapsed() >= SURE_AFTER)
    }
}

/// The processor time of a group of processes all threads of which wait for another thread (on a futex) or for another
/// process of the group; `None` where one does anything else, as to wait for the network, or the system does not say.
#[cfg(target_os = "linux")]
fn ticks_of_waiting(group: u32) -> Option<u64> {
    let mut sum = None;
    for process in std::fs::read_dir("/proc").ok()?.flatten() {
        let is_process =
            process.file_name().to_str().is_some_and(|name| name.bytes().all(|byte| byte.is_ascii_digit()));
        // One that has ended since counts no more.
        let stat = is_process.then(|| std::fs::read_to_string(process.path().join("stat")).ok()).flatten();
        let Some(ticks) = stat.and_then(|stat| ticks_in_group(&stat, group)) else { continue };
        for thread in std::fs::read_dir(process.path().join("task")).ok()?.flatten() {
            let waits_in = std::fs::read_to_string(thread.path().join("wchan")).ok()?;
            if !(waits_in.starts_with("futex") || waits_in == "do_wait") {
                return None;
            }
        }
        sum = Some(sum.unwrap_or(0) + ticks);
    }
    sum
}

#[cfg(not(target_os = "linux"))]
fn ticks_of_waiting(_: u32) -> Option<u64> {
    None
}

/// The processor time in `/proc/PID/stat` (proc_pid_stat(5)) of a process of a group that has not ended.
#[cfg(target_os = "linux")]
fn ticks_in_group(stat: &str, group: u32) -> Option<u64> {
    // The name of the program, in brackets, may hold anything.
    let (_, after_name) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = after_name.split_ascii_whitespace().collect();
    // From the third field on: state, parent, group, ..., 14 utime, 15 stime.
    let number = |field: usize| fields.get(field - 3)?.parse::<u64>().ok();
    let has_ended = matches!(*fields.first()?, "Z" | "X");
    (!has_ended && number(5)? == u64::from(group)).then_some(())?;
    Some(number(14)? + number(15)?)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn processor_time_is_read_for_processes_of_the_group_alone() {
        let stat = "12 (a b) c) S 1 34 34 0 -1 4194304 100 0 0 0 7 5 0 0 20 0 1 0 100 1000 10";
        assert_eq!(ticks_in_group(stat, 34), Some(12));
        assert_eq!(ticks_in_group(stat, 35), None);
        assert_eq!(ticks_in_group(&stat.replace(") S", ") Z"), 34), None);
        assert_eq!(ticks_in_group("12 (a", 34), None);
    }

    #[test]
    fn who_sleeps_or_reads_is_not_deadlocked() {
        // This test's own group has a thread that looks.
        let own = std::process::id();
        let stat = std::fs::read_to_string(format!("/proc/{own}/stat")).unwrap();
        let group: u32 = stat.rsplit_once(')').unwrap().1.split_ascii_whitespace().nth(2).unwrap().parse().unwrap();
        assert_eq!(ticks_of_waiting(group), None);
        let mut watch = Watch::new();
        assert!(!watch.is_deadlocked(group));
        // No process is of this group.
        assert_eq!(ticks_of_waiting(u32::MAX), None);
    }
}
