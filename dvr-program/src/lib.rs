//! Programs that are run: what they say is followed, and they end, with all that they have started, when the work is to
//! end, or when all that they still do is to wait for themselves.
//!
//! ```no_run
//! use std::process::Command;
//!
//! use dvr_core::Cancellation;
//! use dvr_program::{Heard, Patience, Stdout, run};
//!
//! let mut command = Command::new("colmap");
//! command.arg("help");
//! run(&mut command, Stdout::Lines, Patience::Endless, &Cancellation::default(), &mut |heard| {
//!     if let Heard::Out(line) | Heard::Err(line) = heard {
//!         println!("{line}");
//!     }
//! })?;
//! # Ok::<(), dvr_program::ProgramError>(())
//! ```

#![warn(missing_docs)]

mod child;
mod deadlock;
mod error;

pub use child::{Heard, Patience, Stdout, in_words, run};
pub use error::ProgramError;
