//! Errors of training, run folders and evaluation.

use std::path::PathBuf;

/// Result of anything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong, with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A scene or a file could not be used.
    #[error(transparent)]
    Scene(#[from] dvr_core::Error),
    /// The grid method failed.
    #[error(transparent)]
    Grid(dvr_grid::Error),
    /// A configuration value is unknown or out of range.
    #[error("configuration: {0}")]
    Config(String),
    /// A run folder or checkpoint cannot be used.
    #[error("{}: {problem}. {remedy}", path.display())]
    Run {
        /// The folder or file.
        path: PathBuf,
        /// What was found. No full stop at the end.
        problem: String,
        /// What to do, with its full stop.
        remedy: String,
    },
    /// The loss is no longer a number.
    #[error(
        "the loss became {value} in step {step}. The last checkpoint is kept; resume with a smaller learning_rate."
    )]
    Diverged {
        /// The step.
        step: usize,
        /// The loss.
        value: f64,
    },
    /// A step takes more of a graphics processor's memory than it may.
    #[error("{what} about {} of the graphics processor's memory, and {} are allowed: {remedy}", megabytes(*bytes), megabytes(*allowed))]
    Memory {
        /// What takes it, with its verb.
        what: String,
        /// Bytes that it takes.
        bytes: u64,
        /// Bytes that it may.
        allowed: u64,
        /// What to do.
        remedy: String,
    },
    /// No mesh could be extracted.
    #[error("{0}")]
    NoMesh(String),
}

impl From<dvr_grid::Error> for Error {
    fn from(error: dvr_grid::Error) -> Self {
        match error {
            dvr_grid::Error::Scene(error) => Self::Scene(error),
            dvr_grid::Error::Diverged { step, value } => Self::Diverged { step, value },
            #[cfg(feature = "gpu")]
            dvr_grid::Error::Device(problem) => {
                crate::device::refused(problem, "--downscale and a lower --capacity take less")
            }
            other => Self::Grid(other),
        }
    }
}

/// Bytes for people; of few megabytes, hundredths tell what is allowed from what is not.
fn megabytes(bytes: u64) -> String {
    if (1..10_000_000).contains(&bytes) {
        format!("{:.2} MB", bytes.div_ceil(10_000) as f64 / 100.0)
    } else {
        format!("{} MB", bytes.div_ceil(1_000_000))
    }
}
