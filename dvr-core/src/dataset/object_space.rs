//! Into object space: the object in the unit cube, and the similarity back to the world of the files.

use glam::Vec3;
use rayon::prelude::*;

use super::options::{Normalise, ReadOptions};
use super::raw_scene::{ObjectBounds, RawScene};
use super::region_of_interest::{Place, by_masks};
use crate::camera::Similarity;
use crate::error::{Error, Result};
use crate::hold_out::test_views;
use crate::hull::{Bounds, Normalisation};
use crate::number_range::OutOfRange;
use crate::points::PointCloud;
use crate::raster::Mask;
use crate::ray::UnitCube;
use crate::region::{Region, RegionEvidence};
use crate::scene::{Split, View};

/// Share of the object's pixels that may look past the cube before a warning says so.
const TOLERATED_OUTSIDE: f64 = 0.02;

/// Which views have a say in where the object is and what lies on it: those that are not for testing, as long as two of
/// them have masks.
pub(super) fn asked_views(views: &[View], options: &ReadOptions) -> Vec<bool> {
    let parts: Vec<(&str, Split)> = views.iter().map(|view| (view.name.as_str(), view.split)).collect();
    let test = match &options.known_views {
        Some(known) => parts.iter().map(|(name, _)| known.test.iter().any(|test| test == name)).collect(),
        None => test_views(&parts, options.hold_out_every),
    };
    let others = views.iter().zip(&test).filter(|(view, test)| !**test && view.mask.is_some()).count();
    test.into_iter().map(|test| others < 2 || !test).collect()
}

/// Moves views, ground truth and sparse points from the files' space to object space; returns `object_to_world`, and where
/// in the unit cube the object is.
///
/// # Errors
/// [`Error::Normalisation`] where the object cannot be found by its masks, [`Error::NoPlace`] where the files are to say
/// where it is and do not, [`Error::OutOfRange`] for a box without a size.
pub(super) fn into_object_space(
    raw: &mut RawScene,
    views: &mut [View],
    asked: &[bool],
    normalise: Normalise,
) -> Result<(Similarity, Region)> {
    let Place { object_to_files, region, warnings } = place_of_object(raw, views, asked, normalise)?;
    raw.warnings.extend(warnings);
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
    // What was given comes back bit for bit: a run that is resumed stays where it was.
    let object_to_world = match normalise {
        Normalise::Given(given) => given,
        _ => compose(&raw.files_to_world, &object_to_files),
    };
    Ok((object_to_world, region))
}

/// Asks whom `normalise` names for where the object is.
fn place_of_object(raw: &RawScene, views: &[View], asked: &[bool], normalise: Normalise) -> Result<Place> {
    Ok(match (normalise, raw.object_bounds) {
        (Normalise::Auto | Normalise::Files, ObjectBounds::UnitCube) => {
            Place::cube(Similarity::default(), RegionEvidence::Files)
        }
        (Normalise::Files, ObjectBounds::Bound(bound)) => Place::cube(bound, RegionEvidence::Files),
        (Normalise::Files, ObjectBounds::Unknown) => {
            return Err(Error::NoPlace { path: raw.root.clone(), format: raw.format });
        }
        // The files' own space, without the rounding of there and back.
        (Normalise::Given(object_to_world), _) if object_to_world == raw.files_to_world => {
            Place::cube(Similarity::default(), RegionEvidence::Given)
        }
        (Normalise::Given(object_to_world), _) => {
            Place::cube(compose(&raw.files_to_world.inverse(), &object_to_world), RegionEvidence::Given)
        }
        (Normalise::Box(bounds), _) => in_box(raw, bounds)?,
        (Normalise::Auto, ObjectBounds::Bound(bound)) if views.iter().all(|view| view.mask.is_none()) => {
            Place::cube(bound, RegionEvidence::Sphere)
        }
        (Normalise::Auto, ObjectBounds::Bound(bound)) => match by_masks(raw, views, asked, Some(&bound)) {
            Ok(place) => place,
            Err(error) => {
                let mut place = Place::cube(bound, RegionEvidence::Sphere);
                let warning = format!("the sphere of the cameras' file bounds the object, because: {error}");
                place.warnings.push(warning);
                place
            }
        },
        (Normalise::Hull, _) | (Normalise::Auto, ObjectBounds::Unknown) => by_masks(raw, views, asked, None)?,
    })
}

/// The object in a box of the world of the files.
fn in_box(raw: &RawScene, bounds: Bounds) -> Result<Place> {
    let size = bounds.size();
    if !(bounds.min.is_finite() && size.is_finite() && size.min_element() > 0.0) {
        let value = format!("{} to {}", bounds.min, bounds.max);
        return Err(
            OutOfRange::new("the box", value, "finite corners, the second beyond the first along each axis").into()
        );
    }
    let object_to_world = Normalisation::of_bounds(bounds, Vec::new()).object_to_world;
    let region =
        Region { bounds: bounds.moved(&object_to_world.inverse()), hull: None, evidence: vec![RegionEvidence::Box] };
    let object_to_files = compose(&raw.files_to_world.inverse(), &object_to_world);
    Ok(Place { object_to_files, region, warnings: Vec::new() })
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

/// Keeps the sparse points that are on the object: in the unit cube, and on the mask in every view that sees them and is
/// `asked`. Points that no view sees are dropped too. Where the files do not say which views these are, a point must be on every
/// mask that has it in its frame.
pub(super) fn keep_points_on_object(raw: &mut RawScene, views: &[View], asked: &[bool]) {
    let Some(sparse) = &mut raw.sparse_points else { return };
    let cube = UnitCube { padding: 0.0 };
    let has_tracks = sparse.has_tracks();
    // A view without a mask has nothing against a point that it sees.
    let on_mask = |point: Vec3, view: usize| {
        let (view, is_asked) = (&views[view], asked[view]);
        let (pixel, z) = view.camera.project(point.as_dvec3());
        let is_object = |mask: &Mask| mask.is_object(pixel.x as u32, pixel.y as u32);
        let mask = view.mask.as_ref().filter(|_| is_asked);
        if z > 0.0 && view.camera.sees(pixel) { mask.is_none_or(is_object) } else { !has_tracks }
    };
    let on_object = |point: Vec3, seen: &[usize]| match has_tracks {
        true => !seen.is_empty() && seen.iter().all(|&view| on_mask(point, view)),
        false => (0..views.len()).all(|view| on_mask(point, view)),
    };
    let keep: Vec<bool> = sparse
        .cloud
        .points
        .iter()
        .zip(&sparse.visible_in)
        .map(|(&point, seen)| cube.contains(point.as_dvec3()) && on_object(point, seen))
        .collect();
    retain(&mut sparse.visible_in, &keep);
    sparse.bearings.iter_mut().for_each(|bearings| retain(bearings, &keep));
    sparse.errors_px.iter_mut().for_each(|errors| retain(errors, &keep));
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
