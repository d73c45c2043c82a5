//! What there is to say of one layout.

use std::path::Path;

use crate::dataset::options::ReadOptions;
use crate::dataset::raw_scene::RawScene;
use crate::error::Result;

/// One layout of posed photographs. A reader is a file with a constant of this type.
pub(crate) struct Layout {
    /// By what it is asked for.
    pub name: &'static str,
    /// Other names for the same.
    pub aliases: &'static [&'static str],
    /// The files by which it is known, and whose layout it is: for the message where nothing fits.
    pub known_by: &'static str,
    /// Whether its files are at a path.
    pub is_at: fn(&Path) -> Result<bool>,
    /// Finds its views, before any pixel is read.
    pub find: fn(&Path, &ReadOptions) -> Result<RawScene>,
}
