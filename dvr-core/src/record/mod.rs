//! What a figure was made of: the scene's files, the settings, the program and the machine.
//!
//! A row of results carries a [`RecordKey`]. Rows of one key are the same measurement; where a key differs, the row
//! belongs to something else, however it is called.

mod digest;
mod key;
mod machine;

pub use digest::Digest;
pub use key::RecordKey;
pub use machine::Machine;
