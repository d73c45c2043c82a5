//! Camera matrices in `.npz` files: `world_mat_0`, `world_mat_1`, ...

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::{DMat4, DVec4};

use crate::error::{Error, Result};
use crate::npz::NpzFile;

/// The file with the matrices at `path`, a folder or that file itself.
pub(super) fn cameras_npz(path: &Path) -> Option<PathBuf> {
    if path.is_file() {
        return path.extension().is_some_and(|extension| extension == "npz").then(|| path.to_owned());
    }
    ["cameras_sphere.npz", "cameras.npz"].iter().map(|name| path.join(name)).find(|file| file.is_file())
}

/// The numbers of all arrays `<kind>_<number>`.
pub(super) fn numbers_of(npz: &NpzFile, kind: &str) -> BTreeSet<u64> {
    let number = |name: &String| name.strip_prefix(kind)?.strip_prefix('_')?.parse().ok();
    npz.names().iter().filter_map(number).collect()
}

/// Reads array `name`, a 3x3, 3x4 or 4x4 matrix, and completes it to 4x4 by rows and columns of the identity.
///
/// # Errors
/// [`Error::Format`] where the array is missing or damaged, has another shape, or holds a value that is not finite.
pub(super) fn read_matrix(npz: &mut NpzFile, name: &str) -> Result<DMat4> {
    let array = npz.read(name)?;
    let values = array.to_f64();
    let (rows, columns) = match array.shape[..] {
        [rows @ 3..=4, columns @ 3..=4] => (rows, columns),
        _ => {
            return Err(Error::format(
                npz.path(),
                format!("`{name}` has shape {:?}", array.shape),
                "Camera matrices are 4x4, or 3x4 with the rotation on the left.",
            ));
        }
    };
    if let Some(value) = values.iter().find(|value| !value.is_finite()) {
        return Err(Error::format(npz.path(), format!("`{name}` holds {value}"), "Export the cameras again."));
    }
    let mut transposed = DMat4::IDENTITY;
    for (row, values) in values.chunks(columns).enumerate().take(rows) {
        let rest = transposed.col(row).to_array();
        let mut full = [0.0; 4];
        full[..columns].copy_from_slice(values);
        full[columns..].copy_from_slice(&rest[columns..]);
        *transposed.col_mut(row) = DVec4::from_array(full);
    }
    Ok(transposed.transpose())
}
