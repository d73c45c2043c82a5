//! What is wrong with a part of a mesh file, before its place is known.

use std::path::Path;

use crate::error::Error;

/// What is wrong with a part of a mesh file.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Problem {
    /// It is not as the format has it.
    Wrong(String),
    /// It is more than is read.
    TooLarge {
        /// What, with its unit.
        what: &'static str,
        value: u64,
        limit: u64,
    },
}

impl From<String> for Problem {
    fn from(problem: String) -> Self {
        Self::Wrong(problem)
    }
}

impl Problem {
    /// The error of a file; `place` stands before the problem, a line, say.
    pub(super) fn at(self, path: &Path, place: &str, remedy: &str) -> Error {
        match self {
            Self::Wrong(problem) => Error::format(path, format!("{place}{problem}"), remedy),
            Self::TooLarge { what, value, limit } => {
                Error::TooLarge { path: path.to_owned(), what: format!("{place}{what}"), value, limit }
            }
        }
    }
}
