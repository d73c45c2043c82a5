//! Running this program again as a child, which is ended with it.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::channel;
use std::thread::{sleep, spawn};
use std::time::Duration;

use anyhow::{Context, Result};
use dvr_core::Cancellation;

/// Interval of looking whether the child has ended.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// How a child ended.
pub struct EndedChild {
    /// Its exit code, or the signal that ended it.
    pub status: ExitStatus,
    /// What it wrote to standard error.
    pub said: String,
}

/// Runs a command to its end; where somebody wants this program to end, the child is asked to, and waited for, since it
/// may have something to save.
///
/// # Errors
/// When it cannot be started.
pub fn run_child(command: &mut Command, cancellation: &Cancellation) -> Result<EndedChild> {
    run_child_heard(command, cancellation, &mut |_| {})
}

/// [`run_child`], with each line that the child writes to standard error as it comes.
///
/// # Errors
/// When it cannot be started.
pub fn run_child_heard(
    command: &mut Command,
    cancellation: &Cancellation,
    hear: &mut dyn FnMut(&str),
) -> Result<EndedChild> {
    let _shield = cancellation.shield();
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let stderr = child.stderr.take().context("the child has no standard error")?;
    let (sender, lines) = channel();
    let reader = spawn(move || {
        let mut stderr = BufReader::new(stderr);
        let mut line = Vec::new();
        // What was read before an error is worth having.
        while stderr.read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
            if sender.send(String::from_utf8_lossy(&line).into_owned()).is_err() {
                return;
            }
            line.clear();
        }
    });
    let mut said = String::new();
    let mut take = |line: String| {
        hear(line.trim_end());
        said += &line;
    };
    let mut asked = false;
    let status = loop {
        lines.try_iter().for_each(&mut take);
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if cancellation.is_cancelled() && !std::mem::replace(&mut asked, true) {
            ask_to_end(&mut child);
        }
        sleep(LOOK_EVERY);
    };
    lines.iter().for_each(&mut take);
    // It has read to the end: nothing is sent any more.
    let _ = reader.join();
    Ok(EndedChild { status, said })
}

/// Asks a child to save and end. One that ended meanwhile does not hear it.
#[cfg(unix)]
fn ask_to_end(child: &mut Child) {
    use nix::sys::signal::{Signal, kill};
    use nix::unistd::Pid;
    if let Ok(id) = i32::try_from(child.id()) {
        let _ = kill(Pid::from_raw(id), Signal::SIGTERM);
    }
}

/// Ends a child.
#[cfg(not(unix))]
fn ask_to_end(child: &mut Child) {
    let _ = child.kill();
}
