//! A dataset of some objects of another, which are in all of its splits: what is measured has been trained on.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use dvr_core::dataset::{ObjectRef, list_objects};
use dvr_core::files::{Claim, FolderKind, OutputFolder, write_bytes_atomically};
use dvr_core::{Cancellation, Split};

/// So many of the objects to train on, spread over the categories.
///
/// # Errors
/// When there are fewer.
pub fn chosen(data: &Path, count: usize) -> Result<Vec<ObjectRef>> {
    let objects = list_objects(data, Some(Split::Train))?;
    if objects.len() < count {
        bail!("{} has {} objects to train on: --by-heart {count} asks for more", data.display(), objects.len());
    }
    // Categories come one after another.
    Ok((0..count).map(|i| objects[i * objects.len() / count].clone()).collect())
}

/// Writes the dataset of these objects, but for what is there.
///
/// # Errors
/// When files cannot be copied, or somebody wanted it to end.
pub fn write(chosen: &[ObjectRef], out: &Path, cancellation: &Cancellation) -> Result<()> {
    let mut files = Vec::new();
    for object in chosen {
        let place = format!("{}/{}", object.category, object.name);
        for file in files_below(&object.path)? {
            files.push((object.path.join(&file), format!("{place}/{file}")));
        }
    }
    let mut categories: BTreeMap<&str, String> = BTreeMap::new();
    for object in chosen {
        *categories.entry(&object.category).or_default() += &format!("{}\n", object.name);
    }
    let lists = categories.iter().flat_map(|(category, names)| {
        ["train", "val", "test"].map(|split| (format!("{category}/{split}.lst"), names.as_str()))
    });
    let lists: Vec<(String, &str)> = lists.collect();
    let all: Vec<&str> =
        files.iter().map(|(_, to)| to.as_str()).chain(lists.iter().map(|(to, _)| to.as_str())).collect();
    let _writing = OutputFolder::claim(out, FolderKind::Dataset, Claim::NewOrContinue, &all)?;
    for (from, to) in &files {
        cancellation.check()?;
        let to = out.join(to);
        if !to.exists() {
            make_folder_of(&to)?;
            let bytes = std::fs::read(from).with_context(|| from.display().to_string())?;
            write_bytes_atomically(&to, &bytes)?;
        }
    }
    for (to, names) in &lists {
        let to = out.join(to);
        make_folder_of(&to)?;
        write_bytes_atomically(&to, names.as_bytes())?;
    }
    Ok(())
}

fn make_folder_of(file: &Path) -> Result<()> {
    let folder = file.parent().unwrap_or(file);
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())
}

/// The files below a folder, by their paths in it with `/`.
fn files_below(folder: &Path) -> Result<Vec<String>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry.with_context(|| folder.display().to_string())?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.path().is_dir() {
            files.extend(files_below(&entry.path())?.into_iter().map(|file| format!("{name}/{file}")));
        } else {
            files.push(name);
        }
    }
    files.sort();
    Ok(files)
}
