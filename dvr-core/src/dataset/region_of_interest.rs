//! The region of interest of a scene: masks, cameras, sparse points and the files' sphere together say where the object is.

use glam::{DVec2, DVec3};

use super::raw_scene::RawScene;
use crate::camera::{Camera, Similarity};
use crate::error::Result;
use crate::hull::{Bounds, Normalisation, normalisation, normalisation_by_cameras, point_box};
use crate::raster::Mask;
use crate::region::{Region, RegionEvidence, is_cut_by_frame};
use crate::scene::View;

/// Sparse points bound the object where the frame cuts this share of the masks or more. Otherwise outlines do, also where
/// there is no texture.
const CUT_MASKS: f64 = 0.1;

/// What cameras look at bounds the object where the frame cuts this share of the masks or more: then no outline does.
const ALL_CUT: f64 = 0.9;

/// Cameras look at one place where it is in the middle half of this share of the pictures or more.
const CONVERGING: f64 = 0.9;

/// Masks that must show a sparse point.
const MIN_MASKS: usize = 3;

/// The share of the masks that have a point in their frames of which this many may show background there.
const DISAGREEING: f64 = 0.1;

/// Where the object is, in the files' space.
pub(super) struct Place {
    /// Takes the unit cube to the files' space.
    pub object_to_files: Similarity,
    /// In object space.
    pub region: Region,
    /// What was not as it should be.
    pub warnings: Vec<String>,
}

impl Place {
    /// The image of the unit cube.
    pub fn cube(object_to_files: Similarity, evidence: RegionEvidence) -> Self {
        Self { object_to_files, region: Region::unit_cube(evidence), warnings: Vec::new() }
    }
}

/// Finds the object by the masks of the views that are `asked`, in the image of the unit cube under `bound` where that is known and among the sparse
/// points where frames cut masks; without such a bound, near the place that all cameras look at where frames cut all
/// masks. Where no view has a mask, by what all cameras look at.
pub(super) fn by_masks(raw: &RawScene, views: &[View], asked: &[bool], bound: Option<&Similarity>) -> Result<Place> {
    if views.iter().all(|view| view.mask.is_none()) {
        let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
        let mut place = Place::cube(normalisation_by_cameras(&cameras)?, RegionEvidence::Cameras);
        let warning =
            "without masks, the unit cube is what most pictures show around the point that all cameras look at";
        place.warnings.push(warning.to_owned());
        return Ok(place);
    }
    let with_mask = views.iter().zip(asked);
    let asked: Vec<(&Camera, Option<&Mask>)> =
        with_mask.map(|(view, &asked)| (&view.camera, view.mask.as_ref().filter(|_| asked))).collect();
    let mut found = normalisation(&asked)?;
    let (hull, mut evidence) = (found.bounds, vec![RegionEvidence::Masks]);
    let mut cut = |found: Normalisation, region: &Bounds, by: RegionEvidence| {
        let before = found.bounds;
        let found = found.within(region);
        evidence.extend((found.bounds != before).then_some(by));
        found
    };
    if let Some(bound) = bound {
        found = cut(found, &Bounds::cube(bound.translation, 0.5 * bound.scale), RegionEvidence::Sphere);
    }
    let masks: Vec<(&Camera, &Mask)> = asked.iter().filter_map(|(camera, mask)| Some((*camera, (*mask)?))).collect();
    let cut_masks = masks.iter().filter(|(_, mask)| is_cut_by_frame(mask)).count() as f64;
    // The files' sphere says the same, and better.
    if bound.is_none()
        && cut_masks >= ALL_CUT * masks.len() as f64
        && let Some(region) = looked_at(&masks)
    {
        found = cut(found, &region, RegionEvidence::Cameras);
    }
    if cut_masks >= CUT_MASKS * masks.len() as f64 {
        let points = points_within(raw, &masks);
        if let Some(region) = point_box(&points) {
            found = cut(found, &region, RegionEvidence::Points(points.len()));
        }
    }
    let inverse = found.object_to_world.inverse();
    let region = Region { bounds: found.bounds.moved(&inverse), hull: Some(hull.moved(&inverse)), evidence };
    Ok(Place { object_to_files: found.object_to_world, region, warnings: found.warnings })
}

/// The cube around what pictures show of the place that cameras look at: as far from it as the corners of most pictures.
/// `None` where cameras do not look at one place.
fn looked_at(views: &[(&Camera, &Mask)]) -> Option<Bounds> {
    let cameras: Vec<&Camera> = views.iter().map(|(camera, _)| *camera).collect();
    let shown = normalisation_by_cameras(&cameras).ok()?;
    let center = shown.translation;
    let size = |camera: &Camera| DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let is_in_middle = |camera: &&&Camera| {
        let (pixel, z) = camera.project(center);
        z > 0.0 && ((pixel / size(camera) - 0.5).abs().cmple(DVec2::splat(0.25))).all()
    };
    let converging = cameras.iter().filter(is_in_middle).count();
    // The cube around what is seen in full is as wide as the shorter side of most pictures.
    let mut diagonals: Vec<f64> =
        cameras.iter().map(|camera| size(camera).length() / size(camera).min_element()).collect();
    diagonals.sort_by(f64::total_cmp);
    let half = 0.5 * shown.scale * diagonals[diagonals.len() / 2];
    (converging as f64 >= CONVERGING * cameras.len() as f64).then(|| Bounds::cube(center, half))
}

/// The sparse points that some masks show as object and next to none as background: an object's point is within its
/// outline in all of them.
fn points_within(raw: &RawScene, masks: &[(&Camera, &Mask)]) -> Vec<DVec3> {
    let points = raw.sparse_points.iter().flat_map(|sparse| &sparse.cloud.points).map(|point| point.as_dvec3());
    let is_within = |point: &DVec3| {
        let (mut object, mut background) = (0, 0);
        for (camera, mask) in masks {
            let (pixel, z) = camera.project(*point);
            if z > 0.0 && camera.sees(pixel) {
                let shown = mask.is_object(pixel.x as u32, pixel.y as u32);
                *(if shown { &mut object } else { &mut background }) += 1;
            }
        }
        object >= MIN_MASKS && background as f64 <= DISAGREEING * (object + background) as f64
    };
    points.filter(is_within).collect()
}
