//! Writing a rendered object in the layout of the DVR datasets.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat4, DVec3, Vec3};
use rayon::prelude::*;

use super::config::SynthConfig;
use super::lists::{append_to_lists, check_name, register_category};
use super::placement::place_cameras;
use super::render::{MeshRenderer, RenderedView};
use crate::camera::{Camera, Similarity};
use crate::error::{Error, Result};
use crate::files::{TemporaryName, sync_folder, write_depth_exr, write_gray_png, write_rgb_png};
use crate::inside::points_inside;
use crate::mesh::{Mesh, TexturedMesh};
use crate::npz::{Array, Values, write_npz};
use crate::ray::UnitCube;
use crate::sampling::{sample_cube, sample_surface};

/// Renders a mesh to `<out>/<category>/<name>`, and adds it to the lists of the category and to `<out>/metadata.yaml`.
///
/// The object is in all three lists, `train.lst`, `val.lst` and `test.lst`: a scene of its own. `progress` gets how
/// many views are done, and of how many, from whichever thread finishes one. The folder appears when everything is in
/// it.
///
/// Files: `image/%04d.png`, `mask/%04d.png` (0 or 255), `depth/%04d.exr` (z in the mesh's units, background `+inf`),
/// `cameras.npz` (`camera_mat_i`, `world_mat_i`, `scale_mat_i`), `pointcloud.npz` (surface points and normals in object
/// space; `loc` and `scale` lead to the mesh's units), `points.npz` (points of the padded cube in object space, and
/// whether each is inside by its winding number, so that overlapping parts are united and small holes are closed).
///
/// # Errors
/// Where the mesh has no extent, the configuration or a name is unusable, or the folder is there
/// already; [`Error::Io`] where something cannot be written.
pub fn render_dataset(
    mesh: &TexturedMesh,
    name: &str,
    category: &str,
    out: &Path,
    config: &SynthConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<()> {
    render_object(mesh, name, category, out, config, progress)?;
    append_to_lists(&out.join(category), name)?;
    register_category(out, category)
}

/// [`render_dataset`] without lists and metadata.
pub(super) fn render_object(
    mesh: &TexturedMesh,
    name: &str,
    category: &str,
    out: &Path,
    config: &SynthConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<()> {
    config.check()?;
    check_name("object", name)?;
    check_name("category", category)?;
    let folder = out.join(category).join(name);
    if folder.exists() {
        return Err(Error::AlreadyThere { name: folder.display().to_string() });
    }
    let (mesh, object_to_world) = mesh.clone().normalized(config.object_edge)?;
    let partial = PartialFolder::create(out.join(category).join(format!(".{name}.partial")))?;
    write_views(&mesh, &object_to_world, &partial.path, config, progress)?;
    write_ground_truth(&mesh.mesh, &object_to_world, &partial.path, config)?;
    partial.finish(&folder)
}

fn write_views(
    mesh: &TexturedMesh,
    object_to_world: &Similarity,
    folder: &Path,
    config: &SynthConfig,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<()> {
    create_view_folders(folder, config)?;
    let cameras = place_cameras(config);
    let renderer = MeshRenderer::new(mesh, config);
    let done = AtomicUsize::new(0);
    cameras.par_iter().enumerate().try_for_each(|(i, camera)| {
        write_view(folder, i, renderer.render(camera, i as u64), object_to_world, config)?;
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, cameras.len());
        Ok::<(), Error>(())
    })?;
    write_cameras(&folder.join("cameras.npz"), &cameras, object_to_world)
}

/// One view's picture, mask and depth map.
fn write_view(
    folder: &Path,
    index: usize,
    view: RenderedView,
    object_to_world: &Similarity,
    config: &SynthConfig,
) -> Result<()> {
    write_rgb_png(&folder.join(format!("image/{index:04}.png")), &view.image)?;
    write_gray_png(&folder.join(format!("mask/{index:04}.png")), &view.mask.coverage)?;
    if config.depth_maps {
        let in_world_units = view.depth.scaled(object_to_world.scale as f32);
        write_depth_exr(&folder.join(format!("depth/{index:04}.exr")), &in_world_units)?;
    }
    Ok(())
}

/// A picture and the camera that is said to have taken it, both in object space.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// What `cameras.npz` will say.
    pub camera: Camera,
    /// Image, mask and depth.
    pub picture: RenderedView,
}

/// Writes pictures that were taken, and perhaps tampered with, by the caller to `<out>/<category>/<name>`, with the
/// true shape of `mesh` beside them; everything in object space. A folder of that name is replaced.
///
/// # Errors
/// [`Error::FolderName`] where a name is unusable; [`Error::Io`] where something cannot be written.
pub fn write_shots(
    shots: Vec<Shot>,
    mesh: &Mesh,
    name: &str,
    category: &str,
    out: &Path,
    config: &SynthConfig,
) -> Result<()> {
    check_name("object", name)?;
    check_name("category", category)?;
    let folder = out.join(category).join(name);
    let partial = PartialFolder::create(out.join(category).join(format!(".{name}.partial")))?;
    create_view_folders(&partial.path, config)?;
    let cameras: Vec<Camera> = shots.iter().map(|shot| shot.camera.clone()).collect();
    let here = Similarity::default();
    shots
        .into_par_iter()
        .enumerate()
        .try_for_each(|(i, shot)| write_view(&partial.path, i, shot.picture, &here, config))?;
    write_cameras(&partial.path.join("cameras.npz"), &cameras, &here)?;
    write_ground_truth(mesh, &here, &partial.path, config)?;
    if folder.exists() {
        std::fs::remove_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
    }
    partial.finish(&folder)
}

fn create_view_folders(folder: &Path, config: &SynthConfig) -> Result<()> {
    let kinds = ["image", "mask"].into_iter().chain(config.depth_maps.then_some("depth"));
    kinds.into_iter().try_for_each(|kind| create_folder(&folder.join(kind)))
}

/// `camera_mat @ world_mat @ scale_mat @ p` lies in `[-1, 1]`, with (-1, -1) the top left corner of the image.
fn write_cameras(path: &Path, cameras: &[Camera], object_to_world: &Similarity) -> Result<()> {
    let array = |m: &DMat4| Array::f64(&[4, 4], m.transpose().to_cols_array().to_vec());
    let mut arrays = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        // Pixels from the corner to [-1, 1].
        let half = 0.5 * DVec3::new(f64::from(camera.width), f64::from(camera.height), 2.0);
        let to_unit = glam::DMat3::from_cols(DVec3::X / half.x, DVec3::Y / half.y, DVec3::new(-1.0, -1.0, 1.0));
        arrays.push((format!("camera_mat_{i}"), array(&DMat4::from_mat3(to_unit * camera.intrinsics))));
        arrays.push((format!("world_mat_{i}"), array(&camera.into_world(object_to_world).world_to_camera())));
        arrays.push((format!("scale_mat_{i}"), array(&object_to_world.to_matrix())));
    }
    write_npz(path, &arrays.iter().map(|(name, array)| (name.as_str(), array)).collect::<Vec<_>>())
}

fn write_ground_truth(mesh: &Mesh, object_to_world: &Similarity, folder: &Path, config: &SynthConfig) -> Result<()> {
    let vectors = |v: &[Vec3]| Array::f32(&[v.len(), 3], v.iter().flat_map(Vec3::to_array).collect());
    if config.surface_points > 0 {
        let samples = sample_surface(mesh, config.surface_points, config.seed);
        let location = Array::f32(&[3], object_to_world.translation.as_vec3().to_array().to_vec());
        let scale = Array::f32(&[], vec![object_to_world.scale as f32]);
        let (points, normals) = (vectors(&samples.points), vectors(&samples.normals));
        let arrays = [("points", &points), ("normals", &normals), ("loc", &location), ("scale", &scale)];
        write_npz(&folder.join("pointcloud.npz"), &arrays)?;
    }
    if config.occupancy_points > 0 {
        let points = sample_cube(UnitCube::default(), config.occupancy_points, config.seed);
        let inside = points_inside(mesh, &points);
        let occupancies = Array { shape: vec![inside.len()], values: Values::Bool(inside) };
        let arrays = [("points", &vectors(&points)), ("occupancies", &occupancies)];
        write_npz(&folder.join("points.npz"), &arrays)?;
    }
    Ok(())
}

fn create_folder(path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| Error::io(path, e))
}

/// A folder under a temporary name, deleted unless it is finished.
struct PartialFolder {
    path: PathBuf,
    _name: TemporaryName,
}

impl PartialFolder {
    /// Starts an empty folder; what a run that was killed left there is deleted.
    fn create(path: PathBuf) -> Result<Self> {
        if path.exists() {
            std::fs::remove_dir_all(&path).map_err(|e| Error::io(&path, e))?;
        }
        let made = TemporaryName::of(|| std::fs::create_dir_all(&path), |()| path.clone());
        let ((), name) = made.map_err(|e| Error::io(&path, e))?;
        Ok(Self { path, _name: name })
    }

    fn finish(self, name: &Path) -> Result<()> {
        let renamed = std::fs::rename(&self.path, name);
        renamed.and_then(|()| sync_folder(name.parent().unwrap_or(name))).map_err(|e| Error::io(name, e))
    }
}

impl Drop for PartialFolder {
    fn drop(&mut self) {
        // After `finish` there is nothing under this name; after an error the error matters more than what is left.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}
