//! Into object space: the object in the unit cube, and the similarity back to the world of the files.

use glam::Vec3;
use rayon::prelude::*;

use super::options::Normalise;
use super::raw_scene::{ObjectBounds, RawScene};
use crate::camera::{Camera, Similarity};
use crate::error::{Error, Result};
use crate::hull::{normalisation, normalisation_by_cameras};
use crate::points::PointCloud;
use crate::raster::Mask;
use crate::ray::UnitCube;
use crate::scene::View;

/// Share of the object's pixels that may look past the cube before a warning says so.
const TOLERATED_OUTSIDE: f64 = 0.02;

/// Moves views, ground truth and sparse points from the files' space to object space; returns `object_to_world`.
///
/// # Errors
/// [`Error::Normalisation`] where the object cannot be found by its masks, [`Error::NoPlace`] where the files are to say
/// where it is and do not.
pub(super) fn into_object_space(raw: &mut RawScene, views: &mut [View], normalise: Normalise) -> Result<Similarity> {
    let object_to_files = match (normalise, raw.object_bounds) {
        (Normalise::Auto | Normalise::Files, ObjectBounds::UnitCube) => Similarity::default(),
        (Normalise::Files, ObjectBounds::Bound(bound)) => bound,
        (Normalise::Files, ObjectBounds::Unknown) => {
            return Err(Error::NoPlace { path: raw.root.clone(), format: raw.format });
        }
        (Normalise::Given(object_to_world), _) => compose(&raw.files_to_world.inverse(), &object_to_world),
        (Normalise::Auto, ObjectBounds::Bound(bound)) => match by_masks(views) {
            Ok((similarity, warnings)) => {
                raw.warnings.extend(warnings);
                similarity
            }
            Err(error) => {
                raw.warnings.push(format!("the sphere of the cameras' file bounds the object, because: {error}"));
                bound
            }
        },
        (Normalise::Hull, _) | (Normalise::Auto, ObjectBounds::Unknown) => {
            let (similarity, warnings) = by_masks(views)?;
            raw.warnings.extend(warnings);
            similarity
        }
    };
    if object_to_files != Similarity::default() {
        for view in views.iter_mut() {
            view.camera = view.camera.into_object_space(&object_to_files);
            view.depth = view.depth.take().map(|depth| depth.scaled(object_to_files.scale.recip() as f32));
        }
        let inverse = object_to_files.inverse();
        let move_all = |points: &mut Vec<Vec3>| {
            points.iter_mut().for_each(|point| *point = inverse.transform_point_f32(*point));
        };
        if let Some(surface) = &mut raw.ground_truth.surface {
            move_all(&mut surface.points);
            for normal in surface.normals.iter_mut().flatten() {
                *normal = inverse.transform_direction(*normal);
            }
        }
        if let Some(occupancy) = &mut raw.ground_truth.occupancy {
            move_all(&mut occupancy.points);
        }
        if let Some(sparse) = &mut raw.sparse_points {
            move_all(&mut sparse.cloud.points);
        }
    }
    Ok(compose(&raw.files_to_world, &object_to_files))
}

/// Finds the object by its masks; where no view has one, by what all cameras look at.
fn by_masks(views: &[View]) -> Result<(Similarity, Vec<String>)> {
    if views.iter().all(|view| view.mask.is_none()) {
        let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
        let warning =
            "without masks, the unit cube is what most pictures show around the point that all cameras look at";
        return Ok((normalisation_by_cameras(&cameras)?, vec![warning.to_owned()]));
    }
    let views: Vec<_> = views.iter().map(|view| (&view.camera, view.mask.as_ref())).collect();
    normalisation(&views).map(|found| (found.object_to_world, found.warnings))
}

/// `outer` after `inner`.
fn compose(outer: &Similarity, inner: &Similarity) -> Similarity {
    Similarity {
        scale: outer.scale * inner.scale,
        rotation: outer.rotation * inner.rotation,
        translation: outer.transform_point(inner.translation),
    }
}

/// Warns where object pixels look past the padded unit cube: nothing can be reconstructed there.
pub(super) fn check_cube(views: &[View], warnings: &mut Vec<String>) {
    let cube = UnitCube::default();
    let (outside, all) = views
        .par_iter()
        .map(|view| {
            let pixels = view.mask.iter().flat_map(|mask| mask.coverage.enumerate_pixels());
            let object = pixels.filter(|(_, _, coverage)| coverage.0[0] >= 128);
            object.fold((0usize, 0usize), |(outside, all), (u, v, _)| {
                (outside + usize::from(cube.intersect(&view.camera.pixel_ray(u, v)).is_none()), all + 1)
            })
        })
        .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    let share = outside as f64 / all.max(1) as f64;
    if share > TOLERATED_OUTSIDE {
        warnings.push(format!(
            "{:.0} % of the object's pixels look past the unit cube, where nothing can be reconstructed; the visual hull of \
             its masks may be elsewhere",
            100.0 * share
        ));
    }
}

/// Keeps the sparse points that are on the object: in the unit cube, and on the mask in every view that sees them.
/// Points that no view sees are dropped too.
pub(super) fn keep_points_on_object(raw: &mut RawScene, views: &[View]) {
    let Some(sparse) = &mut raw.sparse_points else { return };
    let cube = UnitCube { padding: 0.0 };
    // A view without a mask has nothing against a point that it sees.
    let on_mask = |point: Vec3, view: usize| {
        let view = &views[view];
        let (pixel, z) = view.camera.project(point.as_dvec3());
        let is_object = |mask: &Mask| mask.is_object(pixel.x as u32, pixel.y as u32);
        z > 0.0 && view.camera.sees(pixel) && view.mask.as_ref().is_none_or(is_object)
    };
    let keep: Vec<bool> = sparse
        .cloud
        .points
        .iter()
        .zip(&sparse.visible_in)
        .map(|(&point, seen)| {
            cube.contains(point.as_dvec3()) && !seen.is_empty() && seen.iter().all(|&view| on_mask(point, view))
        })
        .collect();
    retain(&mut sparse.visible_in, &keep);
    let PointCloud { points, normals, colors } = &mut sparse.cloud;
    retain(points, &keep);
    normals.iter_mut().for_each(|normals| retain(normals, &keep));
    colors.iter_mut().for_each(|colors| retain(colors, &keep));
    if sparse.cloud.points.is_empty() {
        raw.warnings.push(format!("none of the {} sparse points lies on the object", keep.len()));
        raw.sparse_points = None;
    }
}

fn retain<T>(items: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    items.retain(|_| keep.next().copied().unwrap_or(true));
}
