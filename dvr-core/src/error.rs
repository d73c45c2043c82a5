//! One error type for everything that reads, checks or writes a scene.

use std::path::{Path, PathBuf};

/// Result of anything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong, written for the person who holds the file: which file, what was found, what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused a file: missing, not readable, disk full, read-only.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder that was asked for.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file was read but does not hold what its format promises.
    #[error("{}: {problem}. {remedy}", path.display())]
    Format {
        /// The offending file.
        path: PathBuf,
        /// What was found, with the value, and what was expected. No full stop at the end.
        problem: String,
        /// What the user can do about it, one sentence with its full stop.
        remedy: String,
    },
    /// Files that are sound one by one do not make a usable scene, or a value given by the caller is unusable.
    #[error("{problem}. {remedy}")]
    Scene {
        /// What is wrong with the scene or value. No full stop at the end.
        problem: String,
        /// What the user can do about it, one sentence with its full stop.
        remedy: String,
    },
}

impl Error {
    /// The operating system's refusal of `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), source }
    }

    /// A file whose content is wrong.
    pub fn format(path: impl AsRef<Path>, problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Format { path: path.as_ref().to_owned(), problem: problem.into(), remedy: remedy.into() }
    }

    /// A scene or value that cannot be used although its files could be read.
    pub fn scene(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Scene { problem: problem.into(), remedy: remedy.into() }
    }
}
