//! Which file belongs to which: images in order, and the mask, depth map or camera of each.

use std::cmp::Ordering;
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Extensions of the pictures that can be read.
const PICTURES: [&str; 8] = ["png", "jpg", "jpeg", "webp", "tif", "tiff", "bmp", "gif"];

/// Extensions of pictures.
pub(super) fn pictures() -> &'static [&'static str] {
    &PICTURES
}

/// Files of a folder with one of the extensions, in natural order (`r_2` before `r_10`). Hidden files are left out.
///
/// # Errors
/// [`Error::Io`] where the folder cannot be listed.
pub(super) fn list_files(folder: &Path, extensions: &[&str]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|source| Error::io(folder, source))? {
        let path = entry.map_err(|source| Error::io(folder, source))?.path();
        let hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if !hidden && extensions.contains(&extension.as_str()) && path.is_file() {
            files.push(path);
        }
    }
    files.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    Ok(files)
}

/// The pictures in a folder, in natural order (`r_2` before `r_10`), by the extensions of what can be read.
///
/// # Errors
/// [`Error::Io`] where the folder cannot be listed.
pub fn list_pictures(folder: &Path) -> Result<Vec<PathBuf>> {
    list_files(folder, &PICTURES)
}

/// The first of the named sub-folders that exists.
pub(super) fn sub_folder(root: &Path, names: &[&str]) -> Option<PathBuf> {
    names.iter().map(|name| root.join(name)).find(|path| path.is_dir())
}

/// File name without folder and extension.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The folder that a file lies in; `.` for a bare name.
pub(super) fn folder_of(file: &Path) -> PathBuf {
    file.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
}

/// Name of a folder, also of `.` and `..`.
pub(super) fn folder_name(root: &Path) -> String {
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    name(root).or_else(|| name(&root.canonicalize().ok()?)).unwrap_or_default()
}

/// Compares names as a person would: runs of digits by their value, so that `r_2` comes before `r_10`.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(&p), Some(&q)) = (x.first(), y.first()) {
        if p.is_ascii_digit() && q.is_ascii_digit() {
            let (digits_x, digits_y) = (leading_digits(x), leading_digits(y));
            let (value_x, value_y) = (without_zeros(digits_x), without_zeros(digits_y));
            let order = value_x.len().cmp(&value_y.len()).then(value_x.cmp(value_y));
            if order.is_ne() {
                return order;
            }
            (x, y) = (&x[digits_x.len()..], &y[digits_y.len()..]);
        } else if p != q {
            return p.cmp(&q);
        } else {
            (x, y) = (&x[1..], &y[1..]);
        }
    }
    x.len().cmp(&y.len()).then(a.cmp(b))
}

fn leading_digits(text: &[u8]) -> &[u8] {
    &text[..text.iter().take_while(|b| b.is_ascii_digit()).count()]
}

fn without_zeros(digits: &[u8]) -> &[u8] {
    &digits[digits.iter().take_while(|&&b| b == b'0').count()..]
}

/// The last number in each stem, where every stem has one and no two are alike.
fn numbers(stems: &[String]) -> Option<Vec<u64>> {
    let last_number = |stem: &String| -> Option<u64> {
        let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
        let start = stem[..end]
            .rfind(|c: char| !c.is_ascii_digit())
            .map_or(0, |i| i + stem[i..].chars().next().map_or(1, char::len_utf8));
        stem[start..end].parse().ok()
    };
    let numbers: Vec<u64> = stems.iter().map(last_number).collect::<Option<_>>()?;
    let distinct: BTreeSet<u64> = numbers.iter().copied().collect();
    (distinct.len() == numbers.len()).then_some(numbers)
}

/// For each image (a path relative to the images' folder) its partner in another folder, a mask or a depth map.
///
/// By name: the same relative path or stem, `name.png.png` (COLMAP), `name_mask`, `mask_name`. Where no name fits: by
/// the number in the name (`000000.png` and `000.png`), or by order where there are as many of both.
///
/// # Errors
/// [`Error::Io`] where the folder cannot be listed.
pub(super) fn partners(images: &[PathBuf], folder: &Path, extensions: &[&str]) -> Result<Vec<Option<PathBuf>>> {
    let files = list_files(folder, extensions)?;
    let stems: Vec<String> = images.iter().map(|image| stem(image)).collect();
    let file_stems: Vec<String> = files.iter().map(|file| stem(file)).collect();
    let unique = stems.iter().collect::<BTreeSet<_>>().len() == stems.len();
    let by_stem: HashMap<&str, &PathBuf> = file_stems.iter().map(String::as_str).zip(&files).collect();
    let by_name: Vec<Option<PathBuf>> = images
        .iter()
        .zip(&stems)
        .map(|(image, stem)| {
            let beside = same_path(folder, image, extensions);
            if beside.is_some() || !unique {
                return beside;
            }
            let full_name = image.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            [stem.clone(), full_name, format!("{stem}_mask"), format!("mask_{stem}"), format!("{stem}_depth")]
                .iter()
                .find_map(|name| by_stem.get(name.as_str()).map(|&path| path.clone()))
        })
        .collect();
    if by_name.iter().any(Option::is_some) || !unique {
        return Ok(by_name);
    }
    if let (Some(wanted), Some(there)) = (numbers(&stems), numbers(&file_stems)) {
        let by_number: HashMap<u64, &PathBuf> = there.into_iter().zip(&files).collect();
        if wanted.iter().all(|number| by_number.contains_key(number)) {
            return Ok(wanted.iter().map(|number| by_number.get(number).map(|&path| path.clone())).collect());
        }
    }
    if files.len() == images.len() {
        return Ok(files.into_iter().map(Some).collect());
    }
    Ok(vec![None; images.len()])
}

/// `folder/relative`, with any of the extensions in place of its own or after it.
fn same_path(folder: &Path, relative: &Path, extensions: &[&str]) -> Option<PathBuf> {
    let path = folder.join(relative);
    let replaced = extensions.iter().map(|extension| path.with_extension(extension));
    let appended = extensions.iter().map(|extension| {
        let mut longer = path.clone().into_os_string();
        longer.push(".");
        longer.push(extension);
        PathBuf::from(longer)
    });
    replaced.chain(appended).find(|candidate| candidate.is_file())
}

/// For each image the index of its camera: the number in its name where all of these have a camera, else its place in
/// the order of the files, where there are as many images as cameras.
///
/// # Errors
/// [`Error::Format`] naming the file of the cameras where neither fits.
pub(super) fn camera_indices(images: &[PathBuf], cameras: &BTreeSet<u64>, file: &Path) -> Result<Vec<u64>> {
    let stems: Vec<String> = images.iter().map(|image| stem(image)).collect();
    if let Some(numbers) = numbers(&stems)
        && numbers.iter().all(|number| cameras.contains(number))
    {
        return Ok(numbers);
    }
    if images.len() == cameras.len() {
        return Ok(cameras.iter().copied().collect());
    }
    Err(Error::format(
        file,
        format!(
            "there are {} cameras for {} images, and the images' names do not say which",
            cameras.len(),
            images.len()
        ),
        "Give one camera an image, or number the images like their cameras (0000.png has camera 0).",
    ))
}

/// A unique name for each view: the stem of its image, with the folders before it where stems alone are not unique.
///
/// # Errors
/// [`Error::Format`] naming `file` where the same image is listed twice.
pub(super) fn view_names(images: &[PathBuf], file: &Path) -> Result<Vec<String>> {
    let stems: Vec<String> = images.iter().map(|image| stem(image)).collect();
    let long = |image: &PathBuf| -> String {
        let folders = image.parent().into_iter().flat_map(|parent| parent.components());
        let folders = folders.filter_map(|part| match part {
            std::path::Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        });
        folders.chain([stem(image)]).collect::<Vec<_>>().join("_")
    };
    let distinct = |names: &[String]| names.iter().collect::<BTreeSet<_>>().len() == names.len();
    if distinct(&stems) {
        return Ok(stems);
    }
    let names: Vec<String> = images.iter().map(long).collect();
    if distinct(&names) {
        return Ok(names);
    }
    let mut seen = BTreeSet::new();
    let twice = names.iter().position(|name| !seen.insert(name)).map(|i| &images[i]);
    let twice = twice.map(|path| path.display().to_string()).unwrap_or_default();
    Err(Error::format(
        file,
        format!("view `{twice}` is there twice"),
        "Remove one of the two, or give the images different names.",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names.iter().map(PathBuf::from).collect()
    }

    fn folder_with(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        folder
    }

    fn partner_names(images: &[&str], masks: &[&str]) -> Vec<Option<String>> {
        let folder = folder_with(masks);
        let found = partners(&paths(images), folder.path(), pictures()).unwrap();
        let name = |path: PathBuf| path.strip_prefix(folder.path()).unwrap().to_string_lossy().into_owned();
        found.into_iter().map(|path| path.map(name)).collect()
    }

    fn all(names: &[&str]) -> Vec<Option<String>> {
        names.iter().map(|name| Some((*name).to_owned())).collect()
    }

    #[test]
    fn files_come_in_the_order_a_person_expects() {
        let folder = folder_with(&["r_10.PNG", "r_2.png", "r_02.png", ".hidden.png", "r_1.txt", "a.jpg"]);
        let files = list_files(folder.path(), pictures()).unwrap();
        assert_eq!(files.iter().map(|path| stem(path)).collect::<Vec<_>>(), ["a", "r_02", "r_2", "r_10"]);
        assert_eq!(natural_order("view7", "view7b"), Ordering::Less);
        assert_eq!(natural_order("99999999999999999999999", "100000000000000000000000"), Ordering::Less);
    }

    #[test]
    fn masks_are_found_by_any_usual_name() {
        assert_eq!(partner_names(&["a.jpg", "b.jpg"], &["b.png", "a.png"]), all(&["a.png", "b.png"]));
        assert_eq!(partner_names(&["a.jpg", "b.jpg"], &["a.jpg.png", "b.jpg.png"]), all(&["a.jpg.png", "b.jpg.png"]));
        assert_eq!(partner_names(&["a.png"], &["a_mask.png", "b_mask.png"]), all(&["a_mask.png"]));
        assert_eq!(
            partner_names(&["one/a.jpg", "two/a.jpg"], &["one/a.png", "two/a.jpg.png"]),
            all(&["one/a.png", "two/a.jpg.png"])
        );
        assert_eq!(
            partner_names(&["000000.png", "000012.png"], &["012.png", "005.png", "000.png"]),
            all(&["000.png", "012.png"])
        );
    }

    #[test]
    fn names_that_say_nothing_are_paired_in_order_if_there_are_as_many() {
        assert_eq!(partner_names(&["x1.png", "x2.png"], &["m0.png", "m1.png"]), all(&["m0.png", "m1.png"]));
        assert_eq!(partner_names(&["x.png", "y.png"], &["m.png"]), [None, None]);
        let partial = partner_names(&["x.png", "y.png"], &["y.png", "z.png"]);
        assert_eq!(partial, [None, Some("y.png".to_owned())], "a name that fits rules out guessing");
    }

    #[test]
    fn cameras_are_found_by_number_before_order() {
        let file = Path::new("cameras.npz");
        let indices = |images: &[&str], n: &[u64]| camera_indices(&paths(images), &n.iter().copied().collect(), file);
        assert_eq!(indices(&["0000.png", "0002.png"], &[0, 1, 2]).unwrap(), [0, 2]);
        assert_eq!(indices(&["1.png", "2.png"], &[0, 1]).unwrap(), [0, 1], "counted from one");
        assert_eq!(indices(&["left.png", "right.png"], &[0, 1]).unwrap(), [0, 1]);
        let error = indices(&["left.png", "right.png"], &[0, 1, 2]).unwrap_err().to_string();
        assert!(error.contains("3 cameras for 2 images"), "{error}");
    }

    #[test]
    fn names_of_views_are_unique() {
        let file = Path::new("transforms.json");
        let images = paths(&["./train/r_0.png", "./test/r_0.png"]);
        assert_eq!(view_names(&images, file).unwrap(), ["train_r_0", "test_r_0"]);
        let error = view_names(&paths(&["a/b.png", "a/b.png"]), file).unwrap_err().to_string();
        assert!(error.contains("transforms.json: view `a/b.png` is there twice"), "{error}");
    }

    #[test]
    fn the_number_of_a_name_is_its_last() {
        let stems = ["dtu65_012é", "dtu65_7"].map(str::to_owned);
        assert_eq!(numbers(&stems), Some(vec![12, 7]));
        assert_eq!(numbers(&["a1".to_owned(), "b1".to_owned()]), None);
    }
}
