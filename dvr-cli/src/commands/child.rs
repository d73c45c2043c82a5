//! Running this program again as a child, which is ended with it.

use std::io::Read;
use std::process::{Child, Command, ExitStatus, Stdio};
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
    let _shield = cancellation.shield();
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let mut stderr = child.stderr.take().context("the child has no standard error")?;
    let reader = spawn(move || {
        let mut said = Vec::new();
        // What was read before an error is worth having.
        let _ = stderr.read_to_end(&mut said);
        String::from_utf8_lossy(&said).into_owned()
    });
    let mut asked = false;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if cancellation.is_cancelled() && !std::mem::replace(&mut asked, true) {
            ask_to_end(&mut child);
        }
        sleep(LOOK_EVERY);
    };
    Ok(EndedChild { status, said: reader.join().unwrap_or_default() })
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
