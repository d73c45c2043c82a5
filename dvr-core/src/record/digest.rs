//! Digests of bytes, values, files and folders.

use std::collections::HashSet;
use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest as _, Sha256};

use crate::error::{Error, Result};

/// The first 16 hexadecimal digits of a SHA-256 digest.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Digest(String);

/// Bytes that are read at once.
const CHUNK: usize = 1 << 16;

impl Digest {
    /// The digest of bytes; that of a file with these bytes is the same.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self::of(Sha256::new_with_prefix(bytes))
    }

    /// The digest of settings: equal for equal values.
    pub fn of_json(value: &Value) -> Self {
        Self::of_bytes(value.to_string().as_bytes())
    }

    /// The digest of several, in their order.
    pub fn of_all<'a>(digests: impl IntoIterator<Item = &'a Self>) -> Self {
        let digests: Vec<&str> = digests.into_iter().map(|digest| digest.0.as_str()).collect();
        Self::of_bytes(digests.join(" ").as_bytes())
    }

    /// The digest of a file's bytes.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read.
    pub fn of_file(path: &Path) -> Result<Self> {
        let fail = |source| Error::io(path, source);
        let mut file = File::open(path).map_err(fail)?;
        let mut hasher = Sha256::new();
        let mut chunk = vec![0; CHUNK];
        loop {
            match file.read(&mut chunk).map_err(fail)? {
                0 => return Ok(Self::of(hasher)),
                read => hasher.update(&chunk[..read]),
            }
        }
    }

    /// The digest of all files in a folder, of their places in it and their bytes; of a file, that of the file. Hidden
    /// files are left out, and so is what lies at `except`. Links are followed, but not in circles.
    ///
    /// # Errors
    /// [`Error::Io`] where something cannot be read.
    pub fn of_files(path: &Path, except: Option<&Path>) -> Result<Self> {
        if path.is_file() {
            return Self::of_file(path);
        }
        let except = except.and_then(|path| path.canonicalize().ok());
        let mut files = Vec::new();
        collect(path, except.as_deref(), &mut HashSet::new(), &mut files)?;
        files.sort();
        let mut hasher = Sha256::new();
        for file in files {
            let place = file.strip_prefix(path).unwrap_or(&file).to_string_lossy().into_owned();
            hasher.update(place.as_bytes());
            // No name of a file holds these two.
            hasher.update([0]);
            hasher.update(Self::of_file(&file)?.0.as_bytes());
            hasher.update([b'/']);
        }
        Ok(Self::of(hasher))
    }

    /// The hexadecimal digits.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    fn of(hasher: Sha256) -> Self {
        Self(hasher.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect())
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// The files below a folder; `above` are the folders that lead to it.
fn collect(folder: &Path, except: Option<&Path>, above: &mut HashSet<PathBuf>, files: &mut Vec<PathBuf>) -> Result<()> {
    let fail = |source| Error::io(folder, source);
    let real = folder.canonicalize().map_err(fail)?;
    if except == Some(real.as_path()) || !above.insert(real.clone()) {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let path = entry.path();
        if entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        match path.is_dir() {
            true => collect(&path, except, above, files)?,
            false => files.push(path),
        }
    }
    above.remove(&real);
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_digest_is_the_start_of_sha256() {
        // FIPS 180-2, appendix B.1.
        assert_eq!(Digest::of_bytes(b"abc").as_str(), "ba7816bf8f01cfea");
        assert_ne!(Digest::of_json(&json!({"steps": 1})), Digest::of_json(&json!({"steps": 2})));
    }

    #[test]
    fn a_folder_is_its_names_and_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let write = |name: &str, text: &str| std::fs::write(path.join(name), text).unwrap();
        let digest = || Digest::of_files(path, Some(&path.join("out"))).unwrap();
        std::fs::create_dir(path.join("image")).unwrap();
        write("image/a.png", "one");
        let first = digest();
        assert_eq!(digest(), first);
        write("image/a.png", "two");
        let other = digest();
        assert_ne!(other, first, "other bytes");
        write("image/a.png", "one");
        std::fs::rename(path.join("image/a.png"), path.join("image/b.png")).unwrap();
        assert_ne!(digest(), first, "another name");
        std::fs::rename(path.join("image/b.png"), path.join("image/a.png")).unwrap();
        write(".hidden", "");
        std::fs::create_dir(path.join("out")).unwrap();
        write("out/results.json", "");
        assert_eq!(digest(), first, "what is hidden or was asked not to count");
        write("mask.png", "");
        assert_ne!(digest(), first, "one more file");
    }

    #[cfg(unix)]
    #[test]
    fn links_in_a_circle_end() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a"), "a").unwrap();
        let without = Digest::of_files(folder.path(), None).unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("again")).unwrap();
        assert_eq!(Digest::of_files(folder.path(), None).unwrap(), without);
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let error = Digest::of_files(Path::new("/no/such"), None).unwrap_err();
        assert!(error.to_string().contains("/no/such"), "{error}");
    }
}
