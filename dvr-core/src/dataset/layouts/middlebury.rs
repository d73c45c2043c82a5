//! The Middlebury multi-view stereo benchmark: `*_par.txt` beside the images.
//!
//! After a line with their number, one line an image: its name, `K` (9 numbers), `R` (9) and `t` (3), world to camera.
//! <https://vision.middlebury.edu/mview/data/>. The benchmark does not say where in a pixel its coordinates are integers;
//! see [`CENTERS_AT_INTEGERS`].

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::layout::Layout;
use crate::dataset::masks::find_masks;
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{folder_of, list_files, view_names};
use crate::dataset::raw_scene::{Projection, RawScene, RawView, is_rotation};
use crate::error::{Error, Result};
use crate::files::read_text;
use crate::scene::Split;

/// Whether pixel centres have integer coordinates, as in the calibration toolboxes of the time.
///
/// Silhouettes do not decide it: the visual hull is largest where the masks agree best, and with masks that are right
/// to about 2 pixels that is at an offset of (-0.2, 1.7) pixels for the temple and (any, 1.5) for the dinosaur, where
/// this adds (0.5, 0.5). Half a pixel is a tenth of a millimetre on the object.
const CENTERS_AT_INTEGERS: bool = true;

/// The Middlebury multi-view benchmark.
pub(super) const LAYOUT: Layout = Layout {
    name: "middlebury",
    aliases: &[],
    known_by: "*_par.txt (Middlebury)",
    is_at: |path| Ok(cameras_file(path).is_some()),
    find,
};

/// The file with the cameras at `path`, which may be that file itself.
fn cameras_file(path: &Path) -> Option<PathBuf> {
    let is_par = |path: &Path| path.file_name().is_some_and(|name| name.to_string_lossy().ends_with("_par.txt"));
    if path.is_file() {
        return is_par(path).then(|| path.to_owned());
    }
    list_files(path, &["txt"]).ok()?.into_iter().find(|file| is_par(file))
}

/// Finds the views of the folder, or of the file.
fn find(path: &Path, _: &ReadOptions) -> Result<RawScene> {
    let cameras = cameras_file(path)
        .ok_or_else(|| Error::format(path, "there is no *_par.txt", "Give the folder that holds it."))?;
    let root = folder_of(&cameras);
    let text = read_text(&cameras)?;
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    let count: Option<usize> = lines.next().and_then(|line| line.parse().ok());
    let listed: Vec<(PathBuf, Projection)> = lines.map(|line| parse_line(line, &cameras)).collect::<Result<_>>()?;
    if count != Some(listed.len()) {
        return Err(Error::format(
            &cameras,
            format!("its first line is not the number of the cameras that follow ({})", listed.len()),
            "The file may be truncated: copy it again.",
        ));
    }
    let relative: Vec<PathBuf> = listed.iter().map(|(image, _)| image.clone()).collect();
    let names = view_names(&relative, &cameras)?;
    let masks = find_masks(&root, &relative)?;
    let views = listed
        .into_iter()
        .zip(names)
        .zip(masks)
        .map(|(((image, projection), name), mask)| RawView {
            name,
            image: root.join(image),
            mask,
            depth: None,
            projection,
            lens: None,
            split: Split::Train,
        })
        .collect();
    Ok(RawScene::new("Middlebury", root, cameras, views))
}

fn parse_line(line: &str, file: &Path) -> Result<(PathBuf, Projection)> {
    let mut words = line.split_whitespace();
    let name = words.next().unwrap_or_default();
    let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).filter(|x: &f64| x.is_finite()).collect();
    let count = line.split_whitespace().count();
    if numbers.len() != 21 || count != 22 {
        return Err(Error::format(
            file,
            format!("the line of `{name}` has {} finite numbers, not 21", numbers.len()),
            "A line is a name, K (9 numbers), R (9) and t (3).",
        ));
    }
    let matrix = |from: usize| DMat3::from_cols_slice(&numbers[from..from + 9]).transpose();
    let rotation = matrix(9);
    if !is_rotation(&rotation) {
        return Err(Error::format(
            file,
            format!("R of `{name}` is not a rotation (determinant {:.3})", rotation.determinant()),
            "A line is a name, K (9 numbers), R (9) and t (3), world to camera.",
        ));
    }
    let projection = Projection::from_parts(matrix(0), rotation, DVec3::from_slice(&numbers[18..]), None);
    Ok((PathBuf::from(name), if CENTERS_AT_INTEGERS { projection.shifted_to_corners() } else { projection }))
}
