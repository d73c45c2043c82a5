//! Programs that are run: what they say is followed, and they end, with all that they have started, when the work is to
//! end.
//!
//! ```no_run
//! use std::process::Command;
//!
//! use dvr_core::Cancellation;
//! use dvr_program::{Heard, Stdout, run};
//!
//! let mut command = Command::new("colmap");
//! command.arg("help");
//! run(&mut command, Stdout::Lines, &Cancellation::default(), &mut |heard| {
//!     if let Heard::Out(line) | Heard::Err(line) = heard {
//!         println!("{line}");
//!     }
//! })?;
//! # Ok::<(), dvr_program::ProgramError>(())
//! ```

#![warn(missing_docs)]

mod child;
mod error;

pub use child::{Heard, Stdout, in_words, run};
pub use error::ProgramError;
