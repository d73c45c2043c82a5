//! Ctrl-C, SIGTERM and SIGHUP: the first asks for a clean end, the second ends the program at once.
//!
//! Long work asks a [`Cancellation`] and returns; what has something to save holds a shield while it does. Work that
//! has nothing to save and does not answer is ended after a moment, so that every phase hears within a second.

use std::thread::{sleep, spawn};
use std::time::Duration;

use anyhow::{Context, Result};
use dvr_core::Cancellation;
use dvr_core::files::remove_temporary_files;

use crate::EXIT_INTERRUPTED;

/// How long work without a shield has to answer.
const PATIENCE: Duration = Duration::from_millis(800);

/// Interval of looking.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// From here on, signals cancel the token that is returned.
pub fn listen() -> Result<Cancellation> {
    let cancellation = Cancellation::default();
    let token = cancellation.clone();
    let hear = move || {
        if !token.cancel() {
            end();
        }
        eprintln!("\nstopping (Ctrl-C again to stop at once)");
        let token = token.clone();
        spawn(move || end_unless_shielded(&token));
    };
    ctrlc::set_handler(hear).context("Ctrl-C cannot be caught")?;
    Ok(cancellation)
}

/// Ends the program when nothing has been to save for long enough.
fn end_unless_shielded(token: &Cancellation) {
    let mut waited = Duration::ZERO;
    while waited < PATIENCE {
        sleep(LOOK_EVERY);
        waited = if token.is_shielded() { Duration::ZERO } else { waited + LOOK_EVERY };
    }
    end();
}

/// Ends the program at once, without temporary files.
fn end() -> ! {
    remove_temporary_files();
    exit_at_once(i32::from(EXIT_INTERRUPTED))
}

/// Without the exit handlers of libraries: drivers of GPUs do not expect them while threads compute.
#[cfg(unix)]
#[allow(unsafe_code)]
fn exit_at_once(code: i32) -> ! {
    // SAFETY: `_exit` takes any code, touches no memory of ours, and does not return.
    unsafe { nix::libc::_exit(code) }
}

#[cfg(not(unix))]
fn exit_at_once(code: i32) -> ! {
    std::process::exit(code)
}
