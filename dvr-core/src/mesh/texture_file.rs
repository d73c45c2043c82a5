//! Files that a model refers to: where they are, and textures out of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

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

/// A texture out of the bytes of its file; where there is none, a warning says why.
pub(super) fn decode_texture(
    name: &str,
    bytes: Result<Vec<u8>, String>,
    warnings: &mut Vec<String>,
) -> Option<Arc<image::RgbaImage>> {
    let texture =
        bytes.and_then(|bytes| image::load_from_memory(&bytes).map_err(|e| format!("cannot be decoded: {e}")));
    match texture {
        Ok(texture) if texture.width() > 0 && texture.height() > 0 => return Some(Arc::new(texture.to_rgba8())),
        Ok(_) => warn_once(warnings, format!("texture {name} is empty: the base colour is used instead")),
        Err(problem) => warn_once(warnings, format!("texture {name} {problem}: the base colour is used instead")),
    }
    None
}

/// The texture that a material in `folder` names; where there is none, a warning says why.
pub(super) fn read_texture(folder: &Path, name: &str, warnings: &mut Vec<String>) -> Option<Arc<image::RgbaImage>> {
    let bytes = find_reference(folder, name)
        .ok_or("is not there".to_owned())
        .and_then(|path| std::fs::read(path).map_err(|e| format!("cannot be read: {e}")));
    decode_texture(name, bytes, warnings)
}
