//! The layout of LLFF (Mildenhall et al. 2019), which NeRF's and NeRD's photographs have: `poses_bounds.npy` beside `images/`.
//!
//! A row of 17 numbers for each picture, in the order of their names: a 3x5 matrix, row by row, and the nearest and farthest
//! depth. Its columns are the directions down, right and backwards of the camera in the world, where the camera stands, and
//! height, width and focal length in pixels. <https://github.com/Fyusion/LLFF#using-your-own-poses-without-running-colmap>.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};

use super::layout::Layout;
use crate::dataset::masks::find_masks;
use crate::dataset::object_files::image_folder;
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{folder_of, list_files, pictures, view_names};
use crate::dataset::raw_scene::{Projection, RawScene, RawView, is_rotation};
use crate::error::{Error, Result};
use crate::npz::read_npy;
use crate::scene::Split;

/// The file with the cameras.
const CAMERAS: &str = "poses_bounds.npy";

/// Numbers of a picture.
const COLUMNS: usize = 17;

const REMEDY: &str =
    "A row is a 3x5 matrix (down, right, backwards, position; height, width, focal length) and two depths.";

/// LLFF's photographs.
pub(super) const LAYOUT: Layout = Layout {
    name: "llff",
    aliases: &["nerd"],
    known_by: "poses_bounds.npy (LLFF)",
    is_at: |path| Ok(cameras_file(path).is_file()),
    find,
};

/// The file with the cameras at `path`, which may be that file itself.
fn cameras_file(path: &Path) -> PathBuf {
    if path.ends_with(CAMERAS) { path.to_owned() } else { path.join(CAMERAS) }
}

/// Finds the views of the folder, or of the file.
fn find(path: &Path, _: &ReadOptions) -> Result<RawScene> {
    let cameras = cameras_file(path);
    if !cameras.is_file() {
        return Err(Error::format(path, format!("there is no {CAMERAS}"), "Give the folder that holds it."));
    }
    let array = read_npy(&cameras)?;
    let &[count, COLUMNS] = array.shape.as_slice() else {
        let problem = format!("its array has the shape {:?}, not [pictures, {COLUMNS}]", array.shape);
        return Err(Error::format(&cameras, problem, REMEDY));
    };
    let root = folder_of(&cameras);
    let image_folder = image_folder(&root)?;
    let mut images = list_files(&image_folder, pictures())?;
    // By their bytes, as Python sorts names, whatever numbers are in them.
    images.sort();
    if images.len() != count {
        let problem = format!("{count} cameras, and {} pictures in {}", images.len(), image_folder.display());
        return Err(Error::format(
            &cameras,
            problem,
            "Cameras belong to pictures by their order: restore those that are missing.",
        ));
    }
    let relative: Vec<PathBuf> = images.iter().filter_map(|path| path.file_name()).map(PathBuf::from).collect();
    let names = view_names(&relative, &image_folder)?;
    let masks = find_masks(&root, &relative)?;
    let numbers = array.to_f64();
    let mut views = Vec::with_capacity(count);
    for (((name, image), mask), row) in names.into_iter().zip(images).zip(masks).zip(numbers.as_chunks().0) {
        let projection = projection(row)
            .map_err(|problem| Error::format(&cameras, format!("the camera of `{name}` {problem}"), REMEDY))?;
        views.push(RawView { name, image, mask, depth: None, projection, lens: None, split: Split::Train });
    }
    Ok(RawScene::new("LLFF", root, cameras, views))
}

/// Of a row; the error is what is wrong with it.
fn projection(row: &[f64; COLUMNS]) -> std::result::Result<Projection, String> {
    let column = |i: usize| DVec3::new(row[i], row[5 + i], row[10 + i]);
    let to_world = DMat3::from_cols(column(1), column(0), -column(2));
    let (center, size) = (column(3), column(4));
    if !center.is_finite() || !is_rotation(&to_world) {
        return Err(format!("has no rotation (determinant {:.3}), or stands nowhere", to_world.determinant()));
    }
    let [height, width, focal] = size.to_array();
    let is_size = |edge: f64| (1.0..=1e6).contains(&edge);
    if !(is_size(height) && is_size(width) && focal.is_finite() && focal > 0.0) {
        return Err(format!("has {width} x {height} pixels and a focal length of {focal}"));
    }
    let k = DMat3::from_cols(focal * DVec3::X, focal * DVec3::Y, DVec3::new(width / 2.0, height / 2.0, 1.0));
    let rotation = to_world.transpose();
    Ok(Projection::from_parts(k, rotation, -(rotation * center), Some((width.round() as u32, height.round() as u32))))
}
