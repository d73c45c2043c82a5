//! Files that a model refers to: where they are, and textures out of them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::Error;
use crate::files::limits::TEXTURE_BYTES;
use crate::files::{decoded_picture, read_bytes, shortened};

/// The file that `name`, found in a file of `folder`, most likely means.
///
/// Models travel between machines: backslashes are taken as slashes; where the path leads nowhere, the bare file name
/// is looked for beside the model, then without regard to case.
pub(super) fn find_reference(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.trim().trim_matches('"').replace('\\', "/");
    let bare = name.rsplit('/').next().unwrap_or_default().to_owned();
    if bare.is_empty() {
        return None;
    }
    let mut candidates = [folder.join(&name), folder.join(&bare)].into_iter();
    candidates.find(|path| path.is_file()).or_else(|| {
        let entries = std::fs::read_dir(if folder.as_os_str().is_empty() { Path::new(".") } else { folder }).ok()?;
        let mut names: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        names.sort();
        names.into_iter().find(|path| {
            path.is_file()
                && path.file_name().is_some_and(|n| n.to_string_lossy().to_lowercase() == bare.to_lowercase())
        })
    })
}

/// Tells of something once, however many materials share it.
pub(super) fn warn_once(warnings: &mut Vec<String>, warning: String) {
    if !warnings.contains(&warning) {
        warnings.push(warning);
    }
}

/// The textures of a mesh: each file is decoded once, and all together have a limit.
#[derive(Default)]
pub(super) struct Textures {
    /// By file; `None` where it cannot be used.
    known: HashMap<PathBuf, Option<Arc<image::RgbaImage>>>,
    /// Bytes of all that were decoded.
    bytes: u64,
}

impl Textures {
    /// The texture that a material in `folder` names; where there is none, a warning says why.
    pub fn read(&mut self, folder: &Path, name: &str, warnings: &mut Vec<String>) -> Option<Arc<image::RgbaImage>> {
        let Some(path) = find_reference(folder, name) else {
            unusable(name, "is not there", warnings);
            return None;
        };
        if let Some(known) = self.known.get(&path) {
            return known.clone();
        }
        let bytes = read_bytes(&path).map_err(reason);
        let texture = self.decode(name, bytes, warnings);
        self.known.insert(path, texture.clone());
        texture
    }

    /// A texture out of the bytes of its file; where there is none, a warning says why.
    pub fn decode(
        &mut self,
        name: &str,
        bytes: Result<Vec<u8>, String>,
        warnings: &mut Vec<String>,
    ) -> Option<Arc<image::RgbaImage>> {
        let texture = bytes.and_then(|bytes| {
            let picture = decoded_picture(Path::new(name), &bytes).map_err(reason)?;
            let size = 4 * u64::from(picture.width()) * u64::from(picture.height());
            if self.bytes + size > TEXTURE_BYTES {
                return Err(format!("would make all textures larger than {TEXTURE_BYTES} bytes"));
            }
            self.bytes += size;
            Ok(picture.into_rgba8())
        });
        texture.map_err(|problem| unusable(name, &problem, warnings)).ok().map(Arc::new)
    }
}

/// Why a picture cannot be decoded, for a message that names it already.
fn reason(error: Error) -> String {
    match error {
        Error::Format { problem, .. } => format!("cannot be decoded: {problem}"),
        Error::TooLarge { what, value, limit, .. } => {
            format!("is too large: {what} is {value}, and at most {limit} is read")
        }
        other => format!("cannot be read: {other}"),
    }
}

fn unusable(name: &str, problem: &str, warnings: &mut Vec<String>) {
    warn_once(warnings, format!("texture {} {problem}: the base colour is used instead", shortened(name)));
}
