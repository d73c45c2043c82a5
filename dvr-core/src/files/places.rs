//! Places of results: single files, and folders beside the data.

use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

use super::leftovers::{folder_of, remove_leftovers};
use crate::error::{Error, OutputError, Result};

/// Whether a single file may be written at `path`: there is none yet, or it may be replaced. Temporary files that a killed
/// process left for it are removed.
///
/// # Errors
/// [`OutputError::FileThere`] where a file is there that may not be replaced, or something that is no file.
pub fn check_file(path: &Path, may_replace: bool) -> Result<()> {
    if let Ok(found) = std::fs::symlink_metadata(path)
        && !(may_replace && (found.is_file() || found.is_symlink()))
    {
        return Err(OutputError::FileThere { path: path.to_owned() }.into());
    }
    remove_leftovers(folder_of(path), Some(path));
    Ok(())
}

/// Refuses a folder for results that is the folder of the data, or lies inside or around it. `data` is a folder or a file
/// in one; either may be missing.
///
/// # Errors
/// [`OutputError::AmongData`]; [`Error::Io`] where a path cannot be resolved.
pub fn check_beside_data(out: &Path, data: &Path) -> Result<()> {
    let folder = if data.is_file() { folder_of(data) } else { data };
    let (ours, theirs) = (resolved(out)?, resolved(folder)?);
    if ours.starts_with(&theirs) || theirs.starts_with(&ours) {
        return Err(OutputError::AmongData { out: out.to_owned(), data: folder.to_owned() }.into());
    }
    Ok(())
}

/// An absolute path without links and `..`, also of what is yet to be made.
fn resolved(path: &Path) -> Result<PathBuf> {
    let refused = |source| Error::io(path, source);
    let absolute = std::path::absolute(path).map_err(refused)?;
    let mut known = absolute.clone();
    let mut missing: Vec<OsString> = Vec::new();
    let mut whole = loop {
        match known.canonicalize() {
            Ok(found) => break found,
            Err(error) => {
                // The last part as it is written, `..` included, which `file_name` would not give.
                let last = known.components().next_back().map(|part| part.as_os_str().to_owned());
                let Some(last) = last.filter(|_| known.pop()) else { return Err(refused(error)) };
                missing.push(last);
            }
        }
    };
    for part in missing.into_iter().rev() {
        match Path::new(&part).components().next() {
            Some(Component::ParentDir) => drop(whole.pop()),
            _ => whole.push(part),
        }
    }
    Ok(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_not_written_among_the_data() {
        let root = tempfile::tempdir().unwrap();
        let photos = root.path().join("photos");
        std::fs::create_dir_all(photos.join("image")).unwrap();
        std::fs::write(photos.join("transforms.json"), "{}").unwrap();
        let at = |path: &str| root.path().join(path);
        for out in ["photos", "photos/run", "photos/image/a/b", "", "new/../photos/run", "photos/../photos"] {
            for data in [&photos, &photos.join("transforms.json")] {
                let error = check_beside_data(&at(out), data).unwrap_err().to_string();
                assert!(error.contains("photos"), "{out}: {error}");
            }
        }
        for out in ["run", "photos-run", "new/../run", "photos/../run"] {
            check_beside_data(&at(out), &photos).unwrap();
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&photos, at("link")).unwrap();
            assert!(check_beside_data(&at("link/run"), &photos).is_err());
        }
        // What is missing is refused elsewhere, by its name.
        check_beside_data(&at("run"), &at("nowhere")).unwrap();
    }

    #[test]
    fn a_file_is_replaced_only_where_that_is_allowed() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("mesh.ply");
        std::fs::write(root.path().join(".mesh.ply.abcdef.dvr-tmp"), "half").unwrap();
        check_file(&path, false).unwrap();
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 0, "what was left for it is gone");
        std::fs::write(&path, "").unwrap();
        assert!(check_file(&path, false).unwrap_err().to_string().contains("mesh.ply"));
        check_file(&path, true).unwrap();
        assert!(check_file(root.path(), true).is_err(), "a folder is no file");
    }
}
