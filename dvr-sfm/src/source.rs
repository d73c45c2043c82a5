//! Where photographs are: a folder of pictures, or a clip.

use std::path::{Path, PathBuf};

use dvr_core::dataset::{MASK_FOLDERS, list_pictures, natural_order};

use crate::error::{Result, SfmError};

/// Folders that hold the pictures of a folder, where it has one of them.
const PICTURE_FOLDERS: [&str; 6] = ["images", "image", "input", "rgb", "photos", "pictures"];

/// Folders that hold something else, beside those of masks.
const OTHER_FOLDERS: [&str; 3] = ["depth", "depths", "normals"];

/// How deep folders of pictures are looked into.
const DEPTH: usize = 3;

/// Pictures that are not read, by their endings.
const HEIC: [&str; 4] = ["heic", "heif", "hif", "avif"];
const RAW: [&str; 9] = ["dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "pef"];

/// Clips, by their endings.
const CLIPS: [&str; 12] = ["mp4", "mov", "m4v", "avi", "mkv", "webm", "mpg", "mpeg", "3gp", "mts", "m2ts", "wmv"];

/// Photographs whose cameras are wanted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// Pictures in a folder.
    Pictures {
        /// The folder that was given, where masks may lie.
        root: PathBuf,
        /// The folder that the paths of the pictures begin at.
        folder: PathBuf,
        /// The pictures below it, in natural order.
        pictures: Vec<PathBuf>,
    },
    /// A clip, of which frames are taken.
    Clip(PathBuf),
}

impl Source {
    /// The photographs at a path; `None` where it is neither a folder with pictures nor a clip.
    ///
    /// # Errors
    /// [`SfmError::OtherFormat`] where pictures are of a kind that is not read; [`SfmError::Core`] where a folder cannot
    /// be listed.
    pub fn at(path: &Path) -> Result<Option<Self>> {
        if Self::is_clip(path) {
            return Ok(Some(Self::Clip(path.to_owned())));
        }
        if !path.is_dir() {
            return Ok(None);
        }
        let below = PICTURE_FOLDERS.iter().map(|name| path.join(name)).find(|folder| folder.is_dir());
        let has_own = !list_pictures(path)?.is_empty();
        let folder = below.filter(|_| !has_own).unwrap_or_else(|| path.to_owned());
        let (mut pictures, mut others) = (Vec::new(), Vec::new());
        walk(&folder, Path::new(""), DEPTH, &mut pictures, &mut others)?;
        check_kinds(&folder, &pictures, others)?;
        if pictures.is_empty() {
            return Ok(None);
        }
        pictures.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
        Ok(Some(Self::Pictures { root: path.to_owned(), folder, pictures }))
    }

    /// Whether a path leads to a clip, by its ending.
    pub fn is_clip(path: &Path) -> bool {
        path.is_file() && has_ending(path, &CLIPS)
    }

    /// The folder or the clip.
    pub fn path(&self) -> &Path {
        match self {
            Self::Pictures { root, .. } => root,
            Self::Clip(clip) => clip,
        }
    }

    /// Whether masks lie beside the photographs. They may also be in an alpha channel, which is not looked for.
    pub fn has_mask_folder(&self) -> bool {
        match self {
            Self::Pictures { root, .. } => MASK_FOLDERS.iter().any(|name| root.join(name).is_dir()),
            Self::Clip(_) => false,
        }
    }

    /// What is there, in a few words.
    pub fn describe(&self) -> String {
        match self {
            Self::Pictures { pictures, .. } => format!("a folder of {} pictures without cameras", pictures.len()),
            Self::Clip(_) => "a clip, of which sharp frames are taken".to_owned(),
        }
    }
}

/// Whether a path has one of the endings.
fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    endings.contains(&ending.as_str())
}

/// Pictures below `root`, by their paths from there, and those of other kinds. Links to folders are not followed.
fn walk(root: &Path, below: &Path, depth: usize, pictures: &mut Vec<PathBuf>, others: &mut Vec<PathBuf>) -> Result<()> {
    let folder = root.join(below);
    for picture in list_pictures(&folder)? {
        pictures.extend(picture.file_name().map(|name| below.join(name)));
    }
    let refused = |source| dvr_core::Error::Io { path: folder.clone(), source };
    for entry in std::fs::read_dir(&folder).map_err(refused)? {
        let entry = entry.map_err(refused)?;
        let name = entry.file_name();
        let text = name.to_string_lossy().to_lowercase();
        let kind = entry.file_type().map_err(refused)?;
        if text.starts_with('.') {
            continue;
        }
        let is_other = MASK_FOLDERS.iter().chain(&OTHER_FOLDERS).any(|other| text == *other);
        if kind.is_dir() && depth > 0 && !is_other {
            walk(root, &below.join(name), depth - 1, pictures, others)?;
        } else if has_ending(Path::new(&text), &HEIC) || has_ending(Path::new(&text), &RAW) {
            others.push(below.join(name));
        }
    }
    Ok(())
}

/// Refuses pictures of a kind that is not read, unless there is another of the same name that is.
fn check_kinds(folder: &Path, pictures: &[PathBuf], mut others: Vec<PathBuf>) -> Result<()> {
    let read: Vec<PathBuf> = pictures.iter().map(|picture| picture.with_extension("")).collect();
    others.retain(|other| !read.contains(&other.with_extension("")));
    others.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    for (endings, kind) in [(&HEIC[..], "HEIC"), (&RAW[..], "camera raw")] {
        let names: Vec<String> = (others.iter().filter(|other| has_ending(other, endings)))
            .map(|other| other.display().to_string())
            .collect();
        if !names.is_empty() {
            return Err(SfmError::OtherFormat { path: folder.to_owned(), names, kind });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_with(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        folder
    }

    fn names_at(path: &Path) -> Vec<String> {
        match Source::at(path).unwrap() {
            Some(Source::Pictures { pictures, .. }) => pictures.iter().map(|path| path.display().to_string()).collect(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn pictures_are_found_with_their_folders_and_without_masks() {
        let folder = folder_with(&["a_10.JPG", "a_2.jpg", "top/b.png", "masks/a_2.png", ".trash/c.jpg", "notes.txt"]);
        assert_eq!(names_at(folder.path()), ["a_2.jpg", "a_10.JPG", "top/b.png"]);
        let folder = folder_with(&["images/x.jpg", "images/y.jpg", "mask/x.png", "preview/z.jpg"]);
        assert_eq!(names_at(folder.path()), ["x.jpg", "y.jpg"]);
        assert!(Source::at(folder.path()).unwrap().is_some_and(|source| source.has_mask_folder()));
    }

    #[test]
    fn what_holds_no_photographs_is_none() {
        let folder = folder_with(&["notes.txt", "clip.MP4"]);
        assert_eq!(Source::at(folder.path()).unwrap(), None);
        let clip = folder.path().join("clip.MP4");
        assert_eq!(Source::at(&clip).unwrap(), Some(Source::Clip(clip)));
        assert_eq!(Source::at(&folder.path().join("nowhere")).unwrap(), None);
        assert_eq!(Source::at(&folder.path().join("notes.txt")).unwrap(), None);
    }

    #[test]
    fn kinds_that_are_not_read_are_named_unless_they_are_there_twice() {
        let folder = folder_with(&["a.jpg", "IMG_2.HEIC", "IMG_10.heic"]);
        let error = Source::at(folder.path()).unwrap_err().to_string();
        assert!(error.contains("HEIC pictures are not read (2 of them): IMG_2.HEIC, IMG_10.heic"), "{error}");
        let folder = folder_with(&["a.jpg", "a.dng", "b.jpg", "b.DNG"]);
        assert_eq!(names_at(folder.path()), ["a.jpg", "b.jpg"]);
        let folder = folder_with(&["c.NEF"]);
        assert!(Source::at(folder.path()).unwrap_err().to_string().contains("camera raw"));
    }
}
