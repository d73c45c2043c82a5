//! Why results may not be written where they were to go.

use std::path::PathBuf;

use crate::folder_kind::FolderKind;

/// Writing would touch what is not ours to touch.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OutputError {
    /// The folder has files in it that this program did not put there.
    #[error("{}: the folder is not empty, and it is not {wanted}", path.display())]
    NotOurs {
        /// The folder.
        path: PathBuf,
        /// What it should be.
        wanted: FolderKind,
    },
    /// The folder holds results of another kind.
    #[error("{}: the folder is {found}, not {wanted}", path.display())]
    OtherKind {
        /// The folder.
        path: PathBuf,
        /// What it is.
        found: FolderKind,
        /// What it should be.
        wanted: FolderKind,
    },
    /// A new folder is wanted, and this one holds results already.
    #[error("{}: the folder already holds {kind}", path.display())]
    InUse {
        /// The folder.
        path: PathBuf,
        /// What it holds.
        kind: FolderKind,
    },
    /// There is nothing in the folder to go on with.
    #[error("{}: the folder does not hold {wanted}", path.display())]
    Missing {
        /// The folder.
        path: PathBuf,
        /// What was looked for.
        wanted: FolderKind,
    },
    /// Another process writes to the folder.
    #[error("{}: another process is writing to this folder", path.display())]
    Locked {
        /// The folder.
        path: PathBuf,
    },
    /// A file is there that this program may not replace.
    #[error("{}: there is a file of this name already", path.display())]
    FileThere {
        /// The file.
        path: PathBuf,
    },
    /// Results would lie among the data, or the data among the results.
    #[error("{}: the folder for results may not be the data's, {}, nor lie inside or around it", out.display(), data.display())]
    AmongData {
        /// The folder for results.
        out: PathBuf,
        /// The folder of the data.
        data: PathBuf,
    },
}
