//! Errors of a reconstruction.

/// What went wrong: with a scene, a configuration, training, or a file.
pub type Error = dvr_train::Error;

/// Result of anything in this crate that can fail.
pub type Result<T> = dvr_train::Result<T>;
