//! One error type for everything that reads, checks or writes a scene; what is wrong with cameras, places and comparisons
//! in a type of its own each.

mod camera;
mod comparison;
mod lens;
mod normalisation;
mod output;

pub use camera::CameraError;
pub use comparison::ComparisonError;
pub use lens::LensError;
pub use normalisation::NormalisationError;
pub(crate) use normalisation::name_views;
pub use output::OutputError;

use std::path::{Path, PathBuf};

use crate::cancellation::Cancelled;
use crate::number_range::OutOfRange;

/// Result of anything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong, written for the person who holds the file: which file, what was found, what to do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Somebody wanted the work to end.
    #[error("{0}")]
    Cancelled(#[from] Cancelled),
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
    /// A file holds, or claims to hold, more than is read; the limits are those of [`files::limits`](crate::files::limits).
    #[error(
        "{}: {what} is {value}, and at most {limit} is read. A damaged file may claim that: check it, or make it smaller.",
        path.display()
    )]
    TooLarge {
        /// The offending file.
        path: PathBuf,
        /// What is too large, with its unit.
        what: String,
        /// How large it is, or would be.
        value: u64,
        /// How large it may be.
        limit: u64,
    },
    /// Nothing at a path is a scene in a layout that is known.
    #[error("{}: no scene was found; looked for {looked_for}. Give the folder that holds one of these.", path.display())]
    NoScene {
        /// The folder or file.
        path: PathBuf,
        /// The files by which layouts are known.
        looked_for: String,
    },
    /// The camera of a view, or the similarity of a scene, cannot be used.
    #[error("{}: {what}{source}", path.display())]
    UnusableCamera {
        /// The file with the cameras.
        path: PathBuf,
        /// Which of them, with a colon and a space, e.g. "view `0003`: "; or nothing.
        what: String,
        /// What is wrong with it.
        source: CameraError,
    },
    /// A matrix makes no camera or no similarity.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The object cannot be found by cameras and masks.
    #[error(transparent)]
    Normalisation(#[from] NormalisationError),
    /// The files are to say where the object is, and their layout does not.
    #[error("{}: the {format} layout does not say where the object is. Find it by the masks, or give a similarity.", path.display())]
    NoPlace {
        /// The scene.
        path: PathBuf,
        /// Its layout, as in [`Scene::format`](crate::Scene::format).
        format: &'static str,
    },
    /// Fewer than two views are left to read or to train on.
    #[error(
        "{scene}: {left} of {all} views {purpose}. A shape needs at least two views, from different sides; more are better."
    )]
    TooFewViews {
        /// The scene.
        scene: String,
        /// Views that are left.
        left: usize,
        /// Views that there are.
        all: usize,
        /// What they are left for: `to read` or `to train on`.
        purpose: &'static str,
    },
    /// A scene that was read again has views that were not there before.
    #[error("{scene}: views were not there when the run began: {}", first(views))]
    ViewsUnknown {
        /// The scene.
        scene: String,
        /// The views.
        views: Vec<String>,
    },
    /// A view that is to be left out does not exist.
    #[error("there is no view `{name}` to leave out. Name a view ({}) or its number.", first(known))]
    UnknownView {
        /// The name or number that was given.
        name: String,
        /// The views that there are.
        known: Vec<String>,
    },
    /// No mask of a scene shows an object.
    #[error(
        "{}: all {masks} masks are empty. A mask is white (or opaque) where the object is: check that masks are not inverted \
         or of another kind.",
        path.display()
    )]
    MasksEmpty {
        /// The scene.
        path: PathBuf,
        /// How many masks it has.
        masks: usize,
    },
    /// A mask has another size than its camera's picture.
    #[error(
        "view {view}: the mask has {}x{} pixels and the camera's image {}x{}. Every view needs a mask of its image's size.",
        mask.0, mask.1, camera.0, camera.1
    )]
    MaskSize {
        /// Index of the view.
        view: usize,
        /// Width and height of the mask.
        mask: (u32, u32),
        /// Width and height of the camera's picture.
        camera: (u32, u32),
    },
    /// A folder holds several objects where one is wanted.
    #[error("{} holds {} objects. Name one of them: {}.", path.display(), objects.len(), first(objects))]
    SeveralObjects {
        /// The folder.
        path: PathBuf,
        /// Paths of the objects.
        objects: Vec<String>,
    },
    /// A dataset has no objects.
    #[error(
        "{} holds no objects. Give the folder of a dataset: categories, and in these objects with `image` and `cameras.npz`.",
        path.display()
    )]
    NoObjects {
        /// The folder.
        path: PathBuf,
    },
    /// A dataset does not have a category.
    #[error("there is no category `{name}`. There are: {}.", known.join(", "))]
    UnknownCategory {
        /// The category that was asked for.
        name: String,
        /// Those that there are.
        known: Vec<String>,
    },
    /// The photographs of a scene take more memory than there is.
    #[error("the photographs take {} MB in memory, and there are {}", bytes.div_ceil(1_000_000), available / 1_000_000)]
    PhotographMemory {
        /// Bytes that they take.
        bytes: u64,
        /// Bytes that the machine has.
        available: u64,
    },
    /// A name is none of a list.
    #[error("`{name}` is not a {what}. Use one of {expected}.")]
    UnknownName {
        /// What it should name.
        what: &'static str,
        /// What was given.
        name: String,
        /// The names that there are.
        expected: String,
    },
    /// A value is out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A name cannot be that of a folder.
    #[error("`{name}` cannot be the name of a folder for the {what}. Use letters, digits, `-` and `_`.")]
    FolderName {
        /// What the folder is for: `object` or `category`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// An object would be written over another.
    #[error("{name} is there already. Delete it, or choose another name or folder.")]
    AlreadyThere {
        /// Path of the folder, or category and name of an object that is given twice.
        name: String,
    },
    /// Results may not be written there.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The faces of a mesh have no extent.
    #[error("a mesh of {faces} faces has no extent, expected a surface")]
    NoExtent {
        /// How many faces it has.
        faces: usize,
    },
    /// Two surfaces have nothing to be aligned by.
    #[error("there is nothing to align: {problem}")]
    NothingToAlign {
        /// What is missing.
        problem: &'static str,
    },
    /// A prediction cannot be compared with the truth.
    #[error(transparent)]
    Comparison(#[from] ComparisonError),
    /// Photographs and masks beyond the memory allowed cannot be kept in a scratch file.
    #[error(
        "{}: photographs cannot be kept in this temporary folder ({source}). It needs room for all pixels beyond the memory \
         allowed, 4 bytes per pixel.",
        folder.display()
    )]
    Scratch {
        /// The system's temporary folder.
        folder: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
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

/// The first five of some names.
fn first(names: &[String]) -> String {
    format!("{}{}", names[..names.len().min(5)].join(", "), if names.len() > 5 { ", ..." } else { "" })
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
}
