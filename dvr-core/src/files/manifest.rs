//! What belongs to a folder of results: its manifest.

use std::path::{Component, Path};

use serde::{Deserialize, Serialize};

use super::atomic::write_bytes_atomically;
use super::read_text;
use crate::error::{Error, Result};
use crate::folder_kind::FolderKind;

/// Name of the manifest.
pub(super) const MANIFEST: &str = "dvr-folder.json";

/// Version of the manifests.
pub(super) const VERSION: u32 = 1;

/// What belongs to a folder of results.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Manifest {
    /// Format version.
    pub version: u32,
    pub kind: FolderKind,
    /// Paths within the folder, with `/`.
    pub files: Vec<String>,
}

impl Manifest {
    /// That of a folder, if it has one.
    pub fn read(root: &Path) -> Result<Option<Self>> {
        let path = root.join(MANIFEST);
        // Not one that lies elsewhere.
        if !std::fs::symlink_metadata(&path).is_ok_and(|found| found.is_file()) {
            return Ok(None);
        }
        let broken = |problem: String| {
            Error::format(&path, problem, "Choose another folder, or remove this one by hand after a look into it.")
        };
        let manifest: Self = serde_json::from_str(&read_text(&path)?)
            .map_err(|error| broken(format!("the list of this folder's files is broken ({error})")))?;
        if manifest.version != VERSION {
            let found = manifest.version;
            return Err(broken(format!("the list of this folder's files has version {found}, expected {VERSION}")));
        }
        if let Some(file) = manifest.files.iter().find(|file| leads_out(file)) {
            return Err(broken(format!("the list of this folder's files names {file:?}, which lies outside of it")));
        }
        Ok(Some(manifest))
    }

    /// Puts it into its folder.
    pub fn write(&self, root: &Path) -> Result<()> {
        let path = root.join(MANIFEST);
        let json = serde_json::to_string_pretty(self);
        let json = json.map_err(|error| Error::io(&path, std::io::Error::other(error)))?;
        write_bytes_atomically(&path, json.as_bytes())
    }
}

/// Whether a path within a folder would leave it.
pub(super) fn leads_out(file: &str) -> bool {
    file.is_empty() || !Path::new(file).components().all(|part| matches!(part, Component::Normal(_)))
}
