//! The layout of the DVR datasets: ShapeNet renders (NMR), DTU, and what `dvr render` writes.
//!
//! An object is a folder with `image/`, `mask/`, `depth/` or `visual_hull_depth/` and `cameras.npz`; beside these may
//! lie `pointcloud.npz` and `points.npz` (the true shape) and `pcl.npz` (points of structure from motion). A view's
//! image is `camera_mat_i @ world_mat_i @ scale_mat_i @ p`, in `[-1, 1]` with `(-1, -1)` at the top left corner;
//! `scale_mat_i` takes object space to the world and may be missing (identity).

use std::path::{Path, PathBuf};

use glam::{DMat4, Vec3};

use super::layout::Layout;
use crate::camera::Similarity;
use crate::dataset::masks::find_masks;
use crate::dataset::matrices::{cameras_npz, numbers_of, read_matrix};
use crate::dataset::object_files::{cameras_file, image_folder};
use crate::dataset::objects::{list_objects, object_folder};
use crate::dataset::options::ReadOptions;
use crate::dataset::pairing::{camera_indices, list_files, partners, pictures, sub_folder, view_names};
use crate::dataset::raw_scene::{Coordinates, ObjectBounds, Projection, RawScene, RawView};
use crate::error::{Error, Result};
use crate::npz::NpzFile;
use crate::points::{OccupancySamples, PointCloud};
use crate::scene::{GroundTruth, SparsePoints, Split};

/// The DVR datasets; see the head of this file.
pub(super) const LAYOUT: Layout = Layout {
    name: "dvr",
    aliases: &[],
    known_by: "cameras.npz, or *.lst and folders with cameras.npz (DVR)",
    // Asked after IDR's, which knows its own cameras.npz by what is in it.
    is_at: |path| {
        let is_object = || cameras_npz(path).is_some() || path.is_dir() && cameras_file(path).is_some();
        Ok(is_object() || path.is_dir() && !list_objects(path, None)?.is_empty())
    },
    find,
};

/// Finds the views of an object, given its folder, or that of a category or dataset with a single object.
fn find(path: &Path, options: &ReadOptions) -> Result<RawScene> {
    let root = object_folder(path)?;
    let ObjectViews { views, indices, cameras, object_to_world, mut warnings } =
        find_views(&root, options.visual_hull_depth)?;
    let unusable = |source| Error::UnusableCamera { path: cameras.clone(), what: String::new(), source };
    let files_to_world = Similarity::from_matrix(&object_to_world).map_err(unusable)?;
    let sparse_points = read_sparse_points(&root, &files_to_world, &indices, &mut warnings)?;
    let ground_truth = read_ground_truth(&root)?;
    Ok(RawScene {
        format: "DVR",
        root,
        cameras,
        views,
        files_to_world,
        object_bounds: ObjectBounds::UnitCube,
        sparse_points,
        ground_truth,
        warnings,
    })
}

/// The views of one object, before any pixel is read.
pub(crate) struct ObjectViews {
    pub views: Vec<RawView>,
    /// The number of each view's camera.
    pub indices: Vec<u64>,
    /// The file with the cameras.
    pub cameras: PathBuf,
    /// The first view's `scale_mat`.
    pub object_to_world: DMat4,
    pub warnings: Vec<String>,
}

/// Finds the views of the object in the folder `root`.
pub(crate) fn find_views(root: &Path, visual_hull_depth: bool) -> Result<ObjectViews> {
    let image_folder = image_folder(root)?;
    let cameras = cameras_file(root).unwrap_or_else(|| root.join("cameras.npz"));
    let images = list_files(&image_folder, pictures())?;
    let relative: Vec<PathBuf> = images.iter().filter_map(|path| path.file_name()).map(PathBuf::from).collect();
    let names = view_names(&relative, &image_folder)?;
    let mut npz = NpzFile::open(&cameras)?;
    let indices = camera_indices(&relative, &numbers_of(&npz, "camera_mat"), &cameras)?;
    let masks = find_masks(root, &relative)?;
    let mut warnings = Vec::new();
    let depths = find_depth(root, &relative, visual_hull_depth, &mut warnings)?;

    let mut object_to_world = None;
    let mut views = Vec::with_capacity(images.len());
    for (i, (name, image)) in names.into_iter().zip(images).enumerate() {
        let scale_mat = read_scale_mat(&mut npz, indices[i])?;
        let first = *object_to_world.get_or_insert(scale_mat);
        if !first.abs_diff_eq(scale_mat, 1e-4 * first.to_scale_rotation_translation().0.max_element()) {
            warnings.push(format!("scale_mat_{} differs from the first, by which results are exported", indices[i]));
        }
        let projection = read_projection(&mut npz, indices[i], &scale_mat)?;
        let (mask, depth) = (masks[i].clone(), depths[i].clone());
        views.push(RawView { name, image, mask, depth, projection, lens: None, split: Split::Train });
    }
    let object_to_world = object_to_world.unwrap_or(DMat4::IDENTITY);
    Ok(ObjectViews { views, indices, cameras, object_to_world, warnings })
}

/// The true shape of the object in the folder `root`, as far as it is there.
pub(crate) fn read_ground_truth(root: &Path) -> Result<GroundTruth> {
    Ok(GroundTruth { surface: read_surface(root)?, occupancy: read_occupancy(root)? })
}

fn read_scale_mat(npz: &mut NpzFile, index: u64) -> Result<DMat4> {
    let name = format!("scale_mat_{index}");
    if npz.contains(&name) { read_matrix(npz, &name) } else { Ok(DMat4::IDENTITY) }
}

/// `camera_mat @ world_mat @ scale_mat`: from object space to `[-1, 1]`.
fn read_projection(npz: &mut NpzFile, index: u64, scale_mat: &DMat4) -> Result<Projection> {
    let camera_mat = read_matrix(npz, &format!("camera_mat_{index}"))?;
    let world_mat = read_matrix(npz, &format!("world_mat_{index}"))?;
    Ok(compose_projection(&camera_mat, &world_mat, scale_mat))
}

pub(crate) fn compose_projection(camera_mat: &DMat4, world_mat: &DMat4, scale_mat: &DMat4) -> Projection {
    Projection::from_matrix(&(*camera_mat * *world_mat * *scale_mat), Coordinates::Normalised)
}

fn find_depth(
    root: &Path,
    images: &[PathBuf],
    prefer_hull: bool,
    warnings: &mut Vec<String>,
) -> Result<Vec<Option<PathBuf>>> {
    let order = if prefer_hull { ["visual_hull_depth", "depth"] } else { ["depth", "visual_hull_depth"] };
    let Some(folder) = sub_folder(root, &order) else { return Ok(vec![None; images.len()]) };
    let depths = partners(images, &folder, &["exr"])?;
    let missing = depths.iter().filter(|depth| depth.is_none()).count();
    if missing > 0 {
        warnings.push(format!("{missing} of {} views have no depth map in {}", images.len(), folder.display()));
    }
    if !prefer_hull && folder.ends_with("visual_hull_depth") {
        warnings.push("depth maps are those of the visual hull (there is no `depth` folder)".to_owned());
    }
    Ok(depths)
}

/// `pcl.npz`: points in the world, which of them are on the object, and which are seen by each view.
fn read_sparse_points(
    root: &Path,
    object_to_world: &Similarity,
    indices: &[u64],
    warnings: &mut Vec<String>,
) -> Result<Option<SparsePoints>> {
    let path = root.join("pcl.npz");
    if !path.is_file() {
        return Ok(None);
    }
    let mut npz = NpzFile::open(&path)?;
    let world_to_object = object_to_world.inverse();
    let points: Vec<Vec3> =
        read_vectors(&mut npz, "points")?.into_iter().map(|point| world_to_object.transform_point_f32(point)).collect();
    let mut visible_in = vec![Vec::new(); points.len()];
    let mut seen_by_any = false;
    for (view, index) in indices.iter().enumerate() {
        let name = format!("visibility_{index:04}");
        if npz.contains(&name) {
            seen_by_any = true;
            for point in read_selection(&mut npz, &name, points.len())? {
                visible_in[point].push(view);
            }
        }
    }
    if !seen_by_any {
        warnings.push(format!("{} does not say which view sees which point and is left out", path.display()));
        return Ok(None);
    }
    let colors = if npz.contains("colors") {
        let colors = npz.read("colors")?;
        let unit = if matches!(colors.values, crate::npz::Values::U8(_)) { 255.0 } else { 1.0 };
        let colors: Vec<[f32; 3]> =
            colors.to_f32().chunks_exact(3).map(|c| [c[0] / unit, c[1] / unit, c[2] / unit]).collect();
        (colors.len() == points.len()).then_some(colors)
    } else {
        None
    };
    if npz.contains("is_in_visual_hull") {
        let name = "is_in_visual_hull";
        let inside = npz.read(name)?.to_bool_of_length(points.len()).ok_or_else(|| wrong_length(&npz, name))?;
        // A point that no view sees is of no use; those who read the scene drop it.
        visible_in.iter_mut().zip(inside).filter(|(_, inside)| !inside).for_each(|(views, _)| views.clear());
    }
    let cloud = PointCloud { points, normals: None, colors };
    Ok(Some(SparsePoints { cloud, visible_in, bearings: None, errors_px: None }))
}

/// Indices that an array selects of `length` items: a mask, or the indices themselves.
fn read_selection(npz: &mut NpzFile, name: &str, length: usize) -> Result<Vec<usize>> {
    let array = npz.read(name)?;
    if let crate::npz::Values::Bool(mask) = &array.values {
        if mask.len() != length {
            return Err(wrong_length(npz, name));
        }
        return Ok((0..length).filter(|&i| mask[i]).collect());
    }
    let valid = |&index: &i64| usize::try_from(index).ok().filter(|&index| index < length);
    let indices = array.to_i64().iter().map(valid).collect::<Option<Vec<usize>>>();
    indices.ok_or_else(|| wrong_length(npz, name))
}

fn read_surface(root: &Path) -> Result<Option<PointCloud>> {
    let path = root.join("pointcloud.npz");
    if !path.is_file() {
        return Ok(None);
    }
    let mut npz = NpzFile::open(&path)?;
    let points = read_vectors(&mut npz, "points")?;
    let normals = if npz.contains("normals") { Some(read_vectors(&mut npz, "normals")?) } else { None };
    if normals.as_ref().is_some_and(|normals| normals.len() != points.len()) {
        return Err(wrong_length(&npz, "normals"));
    }
    Ok(Some(PointCloud { points, normals, colors: None }))
}

/// Points of the padded cube and whether they are inside the object: `points.npz`, where it is there.
pub(crate) fn read_occupancy(root: &Path) -> Result<Option<OccupancySamples>> {
    let path = root.join("points.npz");
    if !path.is_file() {
        return Ok(None);
    }
    let mut npz = NpzFile::open(&path)?;
    let points = read_vectors(&mut npz, "points")?;
    let inside = npz.read("occupancies")?.to_bool_of_length(points.len());
    let inside = inside.ok_or_else(|| wrong_length(&npz, "occupancies"))?;
    Ok(Some(OccupancySamples { points, inside }))
}

/// An array of shape `[n, 3]`.
fn read_vectors(npz: &mut NpzFile, name: &str) -> Result<Vec<Vec3>> {
    let array = npz.read(name)?;
    let values = array.to_f32();
    if array.shape.len() != 2 || array.shape[1] != 3 {
        return Err(Error::format(
            npz.path(),
            format!("`{name}` has shape {:?}, not [n, 3]", array.shape),
            "Write one point a row.",
        ));
    }
    if values.iter().any(|value| !value.is_finite()) {
        return Err(Error::format(npz.path(), format!("`{name}` holds NaN or infinity"), "Write the file anew."));
    }
    Ok(values.chunks_exact(3).map(Vec3::from_slice).collect())
}

fn wrong_length(npz: &NpzFile, name: &str) -> Error {
    Error::format(npz.path(), format!("`{name}` does not fit the number of points"), "Write the file anew.")
}
