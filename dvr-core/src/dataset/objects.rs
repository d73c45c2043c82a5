//! Datasets of many objects: categories, lists of objects and `metadata.yaml`.

use std::path::{Path, PathBuf};

use super::object_files::{IMAGE_FOLDERS, cameras_file};
use super::pairing::{folder_name, folder_of, natural_order};
use crate::error::{Error, Result};
use crate::files::read_text;
use crate::scene::Split;

/// One object of a dataset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectRef {
    /// Folder name of its category, e.g. `03001627`.
    pub category: String,
    /// What `metadata.yaml` calls the category, e.g. `chair`; the folder's name without one.
    pub category_name: String,
    /// Folder name of the object.
    pub name: String,
    /// Its folder.
    pub path: PathBuf,
    /// The list that names it.
    pub split: Split,
}

/// The objects of a dataset in the DVR layout, sorted by category and as the lists have them.
///
/// `root` is the dataset, with a folder for each category, or one category. `train.lst`, `val.lst` and `test.lst` name
/// the objects of each split, one per line; where there is none, `softras_train.lst` and so on are read. A category
/// without any list puts all its objects into [`Split::Train`]. With a `split`, only that one is listed.
///
/// # Errors
/// [`Error::Io`] where a folder or list cannot be read, [`Error::Format`] where a list names an object without a
/// folder.
pub fn list_objects(root: &Path, split: Option<Split>) -> Result<Vec<ObjectRef>> {
    let mut objects = Vec::new();
    if is_category(root)? {
        let names = root.parent().map(category_names).transpose()?.unwrap_or_default();
        list_category(root, &names, split, &mut objects)?;
    } else {
        let names = category_names(root)?;
        for category in sub_folders(root)? {
            if is_category(&category)? {
                list_category(&category, &names, split, &mut objects)?;
            }
        }
    }
    Ok(objects)
}

/// The folders of all objects, each once.
pub(super) fn object_folders(path: &Path) -> Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = list_objects(path, None)?.into_iter().map(|object| object.path).collect();
    paths.sort();
    paths.dedup();
    Ok(paths)
}

/// The folder of the object at `path`: itself, that of its cameras' file, or the only object of a category or dataset.
///
/// # Errors
/// [`Error::SeveralObjects`] listing the objects where there are several.
pub(super) fn object_folder(path: &Path) -> Result<PathBuf> {
    if path.is_file() {
        let folder = folder_of(path);
        let object = if IMAGE_FOLDERS.iter().any(|name| folder.ends_with(name)) { folder_of(&folder) } else { folder };
        return Ok(object);
    }
    if cameras_file(path).is_some() {
        return Ok(path.to_owned());
    }
    match &object_folders(path)?[..] {
        [] => Err(Error::format(
            path,
            "there is no cameras.npz, and no object that has one",
            "Give the folder of an object, with `image` and `cameras.npz`.",
        )),
        [only] => Ok(only.clone()),
        several => {
            let objects = several.iter().map(|object| object.display().to_string()).collect();
            Err(Error::SeveralObjects { path: path.to_owned(), objects })
        }
    }
}

/// A category has lists, or objects in its folders.
fn is_category(folder: &Path) -> Result<bool> {
    let splits = [Split::Train, Split::Val, Split::Test];
    Ok(splits.iter().any(|&split| list_file(folder, split).is_some())
        || sub_folders(folder)?.iter().any(|object| cameras_file(object).is_some()))
}

fn list_file(category: &Path, split: Split) -> Option<PathBuf> {
    let name = match split {
        Split::Train => "train",
        Split::Val => "val",
        Split::Test => "test",
    };
    [format!("{name}.lst"), format!("softras_{name}.lst")]
        .iter()
        .map(|file| category.join(file))
        .find(|path| path.is_file())
}

fn list_category(
    folder: &Path,
    names: &[(String, String)],
    only: Option<Split>,
    objects: &mut Vec<ObjectRef>,
) -> Result<()> {
    let category = folder_name(folder);
    let category_name = names.iter().find(|(id, _)| *id == category).map_or(&category, |(_, name)| name).clone();
    let object = |name: &str, split: Split| ObjectRef {
        category: category.clone(),
        category_name: category_name.clone(),
        name: name.to_owned(),
        path: folder.join(name),
        split,
    };
    let mut any_list = false;
    for split in [Split::Train, Split::Val, Split::Test] {
        let Some(list) = list_file(folder, split) else { continue };
        any_list = true;
        if only.is_some_and(|only| only != split) {
            continue;
        }
        for name in read_text(&list)?.lines().map(str::trim).filter(|name| !name.is_empty()) {
            let object = object(name, split);
            if !object.path.is_dir() {
                return Err(Error::format(
                    &list,
                    format!("object `{name}` has no folder"),
                    "Remove the line, or unpack the whole dataset.",
                ));
            }
            objects.push(object);
        }
    }
    if !any_list && only.is_none_or(|only| only == Split::Train) {
        for path in sub_folders(folder)?.into_iter().filter(|path| cameras_file(path).is_some()) {
            objects.push(object(&folder_name(&path), Split::Train));
        }
    }
    Ok(())
}

fn sub_folders(root: &Path) -> Result<Vec<PathBuf>> {
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(root).map_err(|source| Error::io(root, source))? {
        let path = entry.map_err(|source| Error::io(root, source))?.path();
        if path.is_dir() {
            folders.push(path);
        }
    }
    folders.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(folders)
}

/// `(id, name)` of each category in `metadata.yaml`, which is a mapping of ids to mappings with a `name`:
///
/// ```yaml
/// 03001627:
///   id: 03001627
///   name: chair
/// ```
///
/// Anything else in the file is passed over.
fn category_names(root: &Path) -> Result<Vec<(String, String)>> {
    let path = root.join("metadata.yaml");
    if !path.is_file() {
        return Ok(Vec::new());
    }
    let unquoted = |text: &str| text.trim().trim_matches(['"', '\'']).to_owned();
    let mut names = Vec::new();
    let mut id = None;
    for line in read_text(&path)?.lines() {
        let Some((key, value)) = line.split_once(':') else { continue };
        if !key.starts_with([' ', '\t']) {
            id = Some(unquoted(key));
        } else if key.trim() == "name"
            && let Some(id) = &id
        {
            names.push((id.clone(), unquoted(value)));
        }
    }
    Ok(names)
}
