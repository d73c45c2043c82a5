//! What can go wrong with a report.

use std::path::PathBuf;

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A folder holds no finished run: its figures are missing.
    #[error("{}: the run has no figures ({source})", path.display())]
    NotFinished {
        /// The file of the figures.
        path: PathBuf,
        /// Why it cannot be read.
        source: std::io::Error,
    },
    /// Figures of a run are not what they should be.
    #[error("{}: the file is damaged ({source})", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// The curves of a run cannot be read.
    #[error("{}: the file cannot be read ({source})", path.display())]
    Curves {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: csv::Error,
    },
    /// A run cannot be read.
    #[error(transparent)]
    Run(#[from] dvr_train::Error),
    /// A file cannot be read or written.
    #[error(transparent)]
    Core(#[from] dvr_core::Error),
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Picture(#[from] image::ImageError),
}
