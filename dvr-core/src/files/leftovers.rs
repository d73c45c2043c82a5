//! Temporary files beside their targets: how they are named, and how those of a killed process are removed.

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;

use tempfile::NamedTempFile;

/// The ending of temporary files, by which they are known.
const ENDING: &str = ".dvr-tmp";

/// Most bytes of the target's name within that of its temporary file: names of files are limited to 255.
const NAME_BYTES: usize = 200;

/// The folder that a file lies in. (The parent of a bare file name is the empty path, which no call accepts.)
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A new temporary file beside `path`, locked as long as it is being written.
pub(super) fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    let prefix = prefix(path);
    builder.prefix(&prefix).suffix(ENDING);
    #[cfg(unix)]
    {
        // Temporary files are private by default; the renamed file gets what any new file gets (the umask applies).
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let file = builder.tempfile_in(folder_of(path))?;
    // Where the file system has no locks, the one of the folder still keeps other processes away.
    let _ = file.as_file().try_lock();
    Ok(file)
}

/// How the names of temporary files for `path` begin.
fn prefix(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let end = (0..=name.len().min(NAME_BYTES)).rev().find(|&end| name.is_char_boundary(end)).unwrap_or(0);
    format!(".{}.", &name[..end])
}

/// Whether a file of this name is a temporary file of this program.
pub(super) fn is_temporary(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(ENDING)
}

/// Removes the temporary files that dead processes left in a folder: all, or those for the file `target`.
///
/// What cannot be listed or removed stays: it does no harm.
pub(super) fn remove_leftovers(folder: &Path, target: Option<&Path>) {
    let prefix = target.map_or(String::from("."), prefix);
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_meant = name.to_str().is_some_and(|name| is_temporary(name) && name.starts_with(&prefix));
        // Not of what a link points to.
        if is_meant && entry.file_type().is_ok_and(|kind| kind.is_file()) && is_abandoned(&entry.path()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Whether no living process writes the file.
fn is_abandoned(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| !matches!(file.try_lock(), Err(TryLockError::WouldBlock)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leftovers_of_the_dead_go_and_those_of_the_living_and_of_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [".mesh.ply.abc123.dvr-tmp", ".mesh.obj.abc123.dvr-tmp", ".hidden.tmp", "a.dvr-tmp"] {
            std::fs::write(at(name), "").unwrap();
        }
        std::fs::create_dir(at(".mesh.ply.folder.dvr-tmp")).unwrap();
        let living = temporary_beside(&at("mesh.ply")).unwrap();
        remove_leftovers(folder.path(), Some(&at("mesh.ply")));
        assert!(!at(".mesh.ply.abc123.dvr-tmp").exists() && at(".mesh.obj.abc123.dvr-tmp").exists());
        remove_leftovers(folder.path(), None);
        assert!(!at(".mesh.obj.abc123.dvr-tmp").exists());
        assert!(living.path().exists(), "it is being written");
        let mut left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        left.retain(|name| *name != *living.path().file_name().unwrap());
        left.sort();
        assert_eq!(left, [".hidden.tmp", ".mesh.ply.folder.dvr-tmp", "a.dvr-tmp"]);
    }

    #[test]
    fn names_of_any_length_and_script_have_temporary_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("é".repeat(127));
        let file = temporary_beside(&path).unwrap();
        let name = file.path().file_name().unwrap().to_str().unwrap();
        assert!(is_temporary(name) && name.starts_with(&prefix(&path)) && name.len() < 255);
    }
}
