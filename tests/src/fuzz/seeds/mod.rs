//! Sound files of every kind, as small as they can be.

pub(super) mod arrays;
pub(super) mod networks;
pub(super) mod pictures;
pub(super) mod runs;
pub(super) mod scenes;
pub(super) mod shapes;

use std::path::Path;

/// What `write` puts into the file that it is given.
fn written(name: &str, write: impl FnOnce(&Path)) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap_or_else(|e| panic!("no temporary folder: {e}"));
    let path = folder.path().join(name);
    write(&path);
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}
