//! The small text files of a DVR dataset: which objects belong to which split, and what the categories are called.

use std::path::Path;

use crate::error::{Error, Result};
use crate::files::write_bytes_atomically;
use crate::scene::Split;

/// The splits with the names of their lists.
pub(super) const LISTS: [(Split, &str); 3] =
    [(Split::Train, "train.lst"), (Split::Val, "val.lst"), (Split::Test, "test.lst")];

/// Refuses names that would lead out of the dataset's folder, hide a folder or break a list.
pub(super) fn check_name(what: &'static str, name: &str) -> Result<()> {
    let unusable = |c: char| matches!(c, '/' | '\\') || c.is_control();
    if name.trim() != name || name.is_empty() || name.starts_with('.') || name.contains(unusable) {
        return Err(Error::FolderName { what, name: name.to_owned() });
    }
    Ok(())
}

/// Writes a list, one name per line.
pub(super) fn write_list(path: &Path, names: &[&str]) -> Result<()> {
    let text: String = names.iter().map(|name| format!("{name}\n")).collect();
    write_bytes_atomically(path, text.as_bytes())
}

/// Adds an object to every list of its category that does not have it.
pub(super) fn append_to_lists(category: &Path, name: &str) -> Result<()> {
    for (_, file) in LISTS {
        let path = category.join(file);
        let text = read_or_empty(&path)?;
        let mut names: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
        if !names.contains(&name) {
            names.push(name);
            write_list(&path, &names)?;
        }
    }
    Ok(())
}

/// Adds a category to `metadata.yaml`, where DVR's reference code looks up its name.
pub(super) fn register_category(out: &Path, category: &str) -> Result<()> {
    let path = out.join("metadata.yaml");
    let text = read_or_empty(&path)?;
    // A JSON string is a YAML string too; unquoted, ShapeNet's ids would be read as numbers.
    let quoted = serde_json::Value::from(category).to_string();
    let known = text.lines().filter_map(|line| line.trim_end().strip_suffix(':'));
    if known.into_iter().any(|key| key == category || key == quoted) {
        return Ok(());
    }
    let separator = if text.is_empty() || text.ends_with('\n') { "" } else { "\n" };
    let text = format!("{text}{separator}{quoted}:\n  id: {quoted}\n  name: {quoted}\n");
    write_bytes_atomically(&path, text.as_bytes())
}

fn read_or_empty(path: &Path) -> Result<String> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(text),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(String::new()),
        Err(e) => Err(Error::io(path, e)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_elsewhere_are_refused() {
        for name in ["", ".", "..", ".hidden", "a/b", "a\\b", "a\nb", " a"] {
            assert!(check_name("object", name).is_err(), "{name:?}");
        }
        assert!(check_name("category", "02691156").is_ok() && check_name("object", "Ein Stuhl-1").is_ok());
    }

    #[test]
    fn lists_and_categories_grow_without_repeating() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a", "b", "a"] {
            append_to_lists(folder.path(), name).unwrap();
            register_category(folder.path(), "02691156").unwrap();
        }
        assert_eq!(std::fs::read_to_string(folder.path().join("val.lst")).unwrap(), "a\nb\n");
        let metadata = std::fs::read_to_string(folder.path().join("metadata.yaml")).unwrap();
        assert_eq!(metadata, "\"02691156\":\n  id: \"02691156\"\n  name: \"02691156\"\n");
    }
}
