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
    /// Views have no mask, and what was asked for needs one of each.
    #[error(
        "{} no mask. Give each picture an alpha channel, put a mask of the same name (white on the object) into a folder \
         `mask` or `masks` beside the images, or take what differs from a plain background (white, black, or each \
         picture's border) as the object.",
        listed(views)
    )]
    MasksMissing {
        /// Names of the views, in the order of the scene.
        views: Vec<String>,
    },
}

/// Some names with their verb: "view `a` has", "views `a`, `b`, `c` and 3 more have".
fn listed(views: &[String]) -> String {
    let first: Vec<String> = views.iter().take(3).map(|name| format!("`{name}`")).collect();
    let more = views.len().saturating_sub(first.len());
    let (noun, verb) = if views.len() == 1 { ("view", "has") } else { ("views", "have") };
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{noun} {}{rest} {verb}", first.join(", "))
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
