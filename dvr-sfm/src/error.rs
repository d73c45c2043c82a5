//! What can go wrong between photographs and cameras.

use std::path::{Path, PathBuf};

use dvr_core::Cancelled;

/// Result of anything in this crate that can fail.
pub(crate) type Result<T> = std::result::Result<T, SfmError>;

/// What went wrong, for the person who holds the photographs.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// Somebody wanted the work to end. What is finished is kept.
    #[error("{0}")]
    Cancelled(#[from] Cancelled),
    /// A file could not be read or written.
    #[error(transparent)]
    Core(dvr_core::Error),
    /// A program that does the work is not installed.
    #[error("`{program}`, which {purpose}, is not among the programs of this machine")]
    NotInstalled {
        /// `colmap`, `glomap` or `ffmpeg`.
        program: &'static str,
        /// What it does, in the present tense.
        purpose: &'static str,
    },
    /// There are too few pictures for cameras to be found.
    #[error("{}: {found} of the pictures can be used, and cameras are found from {least} on. {TAKE_MORE}", path.display())]
    TooFewPictures {
        /// Where they were looked for.
        path: PathBuf,
        /// How many there are.
        found: usize,
        /// How many there must be.
        least: usize,
    },
    /// Pictures in a format that is not read.
    #[error("{}: {kind} pictures are not read ({} of them): {}", path.display(), names.len(), some(names))]
    OtherFormat {
        /// Where they are.
        path: PathBuf,
        /// Their names.
        names: Vec<String>,
        /// The format: `HEIC` or `camera raw`.
        kind: &'static str,
    },
    /// Two pictures differ in the endings of their names alone.
    #[error("{}: `{first}` and `{second}` have one name. Remove one of the two, or rename it.", path.display())]
    SameName {
        /// Where they are.
        path: PathBuf,
        /// One of them.
        first: String,
        /// The other.
        second: String,
    },
    /// The folder has cameras of other photographs, or found with other options.
    #[error("{} has cameras of other photographs, or found by other options", path.display())]
    OtherPhotographs {
        /// The folder.
        path: PathBuf,
    },
    /// No two pictures show the same thing from different places.
    #[error(
        "no cameras were found: the {pictures} pictures do not show one thing from overlapping sides, or show too little \
         that is textured. {TAKE_MORE} What COLMAP said: {}",
        log.display()
    )]
    NoModel {
        /// How many pictures there are.
        pictures: usize,
        /// All that COLMAP said.
        log: PathBuf,
    },
    /// A set of photographs shares too little with the others.
    #[error(
        "the photographs of `{set}` cannot be placed among those of the other sets: {agreeing} of the {shared} points of the \
         object that both show agree about where, and {least} must. What COLMAP said: {}",
        log.display()
    )]
    NotConnected {
        /// The name of the set.
        set: String,
        /// Points that it shares with the sets that are placed.
        shared: usize,
        /// Those that agree.
        agreeing: usize,
        /// How many must.
        least: usize,
        /// All that COLMAP said.
        log: PathBuf,
    },
    /// COLMAP's database cannot be read.
    #[error("{}: this is no database that COLMAP wrote ({said}). Remove the folder of cameras that it is in, and begin anew", path.display())]
    BadDatabase {
        /// The file.
        path: PathBuf,
        /// What SQLite said.
        said: String,
    },
    /// COLMAP or ffmpeg came to no good end.
    #[error("{program} failed at {step} ({how}): {said}{}", all_in(log))]
    Failed {
        /// `colmap`, `glomap` or `ffmpeg`.
        program: &'static str,
        /// What it was at.
        step: &'static str,
        /// Its exit code or signal.
        how: String,
        /// Its last words.
        said: String,
        /// All of them; empty where they are not kept.
        log: PathBuf,
    },
    /// Points that a surface is to go through have no normals.
    #[error("none of the {points} points has a normal (nx, ny, nz), and a surface needs to know its outside")]
    NoNormals {
        /// How many points there are.
        points: usize,
    },
    /// Nothing is left of a surface.
    #[error("nothing is left of the surface of {points} points, trimmed at {trim}")]
    NoSurface {
        /// How many points there are.
        points: usize,
        /// Where the surface was trimmed.
        trim: f64,
    },
    /// The installed ffmpeg cannot make clips of a format.
    #[error("the installed ffmpeg has no encoder `{encoder}`, which makes {format} clips")]
    NoEncoder {
        /// What ffmpeg calls it.
        encoder: &'static str,
        /// `MP4` or `WebM`.
        format: &'static str,
    },
    /// A clip gives no frames.
    #[error("{}: no frames can be read from the clip ({said})", path.display())]
    BadClip {
        /// The clip.
        path: PathBuf,
        /// What ffmpeg said.
        said: String,
    },
}

/// What helps against most of it.
const TAKE_MORE: &str = "Take 30 or more from all sides, each overlapping its neighbours by two thirds.";

impl From<dvr_core::Error> for SfmError {
    fn from(error: dvr_core::Error) -> Self {
        match error {
            dvr_core::Error::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Core(other),
        }
    }
}

/// Where all that a program said is kept, as a sentence's end and one more sentence.
fn all_in(log: &Path) -> String {
    if log.as_os_str().is_empty() { String::new() } else { format!(". All that it said: {}", log.display()) }
}

/// The first names of a list, and how many more there are.
pub(crate) fn some(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let shown = names.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown} and {} more", names.len() - SHOWN) } else { shown }
}
