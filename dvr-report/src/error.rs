//! What can go wrong with a report.

use std::path::PathBuf;

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A folder holds no finished run.
    #[error("{}: {problem}. {remedy}", path.display())]
    NotARun {
        /// The folder or the file in it.
        path: PathBuf,
        /// What was found.
        problem: String,
        /// What to do.
        remedy: String,
    },
    /// A run or its files cannot be read.
    #[error(transparent)]
    Run(#[from] dvr_train::Error),
    /// A file cannot be read or written.
    #[error(transparent)]
    Core(#[from] dvr_core::Error),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Picture(#[from] image::ImageError),
}
