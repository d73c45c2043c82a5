//! The digest of a scene: of everything that reading it may look at.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::layouts::{detect_format, find_views};
use super::options::ReadOptions;
use super::raw_scene::RawView;
use crate::error::Result;
use crate::record::Digest;

/// The digest of the scene at `path`: of all files in its folder, and of pictures, masks and depth maps that its
/// cameras name elsewhere. What lies at `except`, results in the scene's own folder, does not count.
///
/// # Errors
/// As [`read_scene`](super::read_scene) before any pixel is read; where a file cannot be read.
pub fn digest_of_scene(path: &Path, options: &ReadOptions, except: Option<&Path>) -> Result<Digest> {
    let format = options.format.map_or_else(|| detect_format(path), Ok)?;
    let raw = find_views(format, path, options)?;
    let mut digests = vec![Digest::of_files(&raw.root, except)?];
    let files = |view: RawView| [Some(view.image), view.mask, view.depth].into_iter().flatten();
    let root = raw.root.canonicalize().unwrap_or(raw.root);
    let is_outside = |file: &PathBuf| file.canonicalize().is_ok_and(|file| !file.starts_with(&root));
    let outside: BTreeSet<PathBuf> = raw.views.into_iter().flat_map(files).filter(is_outside).collect();
    for file in &outside {
        digests.push(Digest::of_file(file)?);
    }
    Ok(Digest::of_all(&digests))
}
