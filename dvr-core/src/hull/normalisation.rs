//! Where the object is: from cameras of any units to the unit cube.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::bounds::Bounds;
use super::consistency::rejected;
use super::search::{SEARCH_RESOLUTION, search, tightened};
use super::settings::HullSettings;
use super::silhouette::Silhouette;
use super::visual_hull::VisualHull;
use crate::camera::{Camera, Similarity};
use crate::error::{NormalisationError, Result, name_views};
use crate::raster::Mask;

/// Edge of the object's box in the unit cube; the rest keeps the surface off the faces while it is learned.
const OBJECT_EDGE: f64 = 0.9;

/// Voxels along an edge for the box that is returned.
const FINAL_RESOLUTION: usize = 128;

/// Where the object lies in the world of the files.
#[derive(Clone, Debug, PartialEq)]
pub struct Normalisation {
    /// Takes the unit cube to the world: a uniform scale and a translation.
    pub object_to_world: Similarity,
    /// The box of the visual hull, in the world.
    pub bounds: Bounds,
    /// What was not as it should be, in plain words. Views are counted from 0, in the order they were given.
    pub warnings: Vec<String>,
}

impl Normalisation {
    /// The object fills this box but for a margin: its longest edge becomes 0.9.
    pub(crate) fn of_bounds(bounds: Bounds, warnings: Vec<String>) -> Self {
        let scale = bounds.size().max_element() / OBJECT_EDGE;
        let object_to_world = Similarity { scale, rotation: DQuat::IDENTITY, translation: bounds.center() };
        Self { object_to_world, bounds, warnings }
    }

    /// The same where the object is known to lie in a region: what sticks out of it is cut off. Masks that the frame
    /// cuts leave a hull that no view bounds there.
    pub fn within(self, region: &Bounds) -> Self {
        match self.bounds.intersection(region) {
            Some(bounds) if bounds != self.bounds => Self::of_bounds(bounds, self.warnings),
            _ => self,
        }
    }
}

/// Finds the object's box from cameras and masks alone, whatever the units and the origin of the world.
///
/// The similarity takes the unit cube to the world without rotation; the longest edge of the visual hull's box becomes
/// 0.9. The search starts around the point that is nearest to the rays through the masks' centroids, carves coarsely,
/// grows where the hull touches the region's border and shrinks around what is left.
///
/// Of the hulls that explain the masks, the one is taken whose points are seen by the most views (all, three quarters,
/// half, ... at least one in ten): otherwise the hull of an object that leaves the pictures would have spurs to infinity,
/// where no other view looks. If the strict hull explains the masks badly, some views are allowed to disagree, and a warning names
/// those that stand out. Views without a mask do not count.
///
/// # Errors
/// When fewer than two views show the object, all look along one line, or no place agrees with most of the masks; the
/// message then names the views that disagree most with the others.
pub fn normalisation(views: &[(&Camera, Option<&Mask>)]) -> Result<Normalisation> {
    let masks: Vec<(usize, &Camera, &Mask)> =
        (views.iter().enumerate()).filter_map(|(i, (camera, mask))| mask.map(|mask| (i, *camera, mask))).collect();
    let (shown, empty): (Vec<_>, Vec<_>) = masks.into_iter().partition(|(_, _, mask)| mask.object_pixels() > 0);
    if shown.len() < 2 {
        return Err(NormalisationError::TooFewMasks { shown: shown.len(), masks: shown.len() + empty.len() }.into());
    }
    let mut warnings = Vec::new();
    if !empty.is_empty() {
        let empty: Vec<usize> = empty.iter().map(|(i, ..)| *i).collect();
        warnings
            .push(format!("{} an empty mask and did not help to find the object", name_views(&empty, "has", "have")));
    }
    let views: Vec<(&Camera, &Mask)> = shown.iter().map(|(_, camera, mask)| (*camera, *mask)).collect();
    let shown: Vec<usize> = shown.iter().map(|(i, ..)| *i).collect();
    let silhouettes = Silhouette::all(&views)?;
    let region = starting_region(&views)?;

    let found = search(&silhouettes, region)?.filter(|found| found.typically_unexplained() < 0.5);
    let Some((found, region)) = found.and_then(|found| tightened(&found.hull).map(|region| (found, region))) else {
        return Err(disagreement(&silhouettes, region, &shown)?.into());
    };
    warnings.extend(found.warnings(&silhouettes, &shown));
    let hull = VisualHull::carve_silhouettes(&silhouettes, region, FINAL_RESOLUTION, &found.settings)?;
    let bounds = hull.bounding_box().unwrap_or(region);
    Ok(Normalisation::of_bounds(bounds, warnings))
}

/// The cube around the point that all cameras look at, as large as most pictures show it in full: what is left to say
/// without masks. The similarity takes the unit cube to the world without rotation.
///
/// # Errors
/// When all cameras look along the same direction, or away from each other.
pub fn normalisation_by_cameras(cameras: &[&Camera]) -> Result<Similarity> {
    let middle = |camera: &Camera| 0.5 * DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let axes: Vec<(DVec3, DVec3)> = (cameras.iter())
        .map(|camera| {
            let ray = camera.ray(middle(camera));
            (ray.origin, ray.direction.normalize())
        })
        .collect();
    let center = nearest_to_rays(&axes).ok_or(NormalisationError::ParallelCameras)?;
    let mut radii: Vec<f64> = (cameras.iter())
        .filter_map(|camera| {
            let focal = camera.intrinsics.x_axis.x.max(camera.intrinsics.y_axis.y);
            let z = camera.project(center).1;
            (z > 0.0).then(|| z * middle(camera).min_element() / focal)
        })
        .collect();
    radii.sort_by(f64::total_cmp);
    match radii.get(radii.len() / 2) {
        Some(&radius) if radius.is_finite() && radius > 0.0 => {
            Ok(Similarity { scale: 2.0 * radius, rotation: DQuat::IDENTITY, translation: center })
        }
        _ => Err(NormalisationError::BehindCameras.into()),
    }
}

/// The cube in which the search begins: around the point nearest to the rays through the masks' centroids, as large
/// as the masks' extents say.
fn starting_region(views: &[(&Camera, &Mask)]) -> Result<Bounds> {
    let extents: Vec<Extent> = views.iter().map(|(_, mask)| Extent::of(mask)).collect();
    let rays: Vec<(DVec3, DVec3)> = views
        .iter()
        .zip(&extents)
        .map(|((camera, _), extent)| {
            let ray = camera.ray(extent.centroid);
            (ray.origin, ray.direction.normalize())
        })
        .collect();
    let center = nearest_to_rays(&rays).ok_or(NormalisationError::ParallelCameras)?;
    let mut radii: Vec<f64> = views
        .iter()
        .zip(&extents)
        .filter_map(|((camera, _), extent)| {
            let (pixel, z) = camera.project(center);
            let focal = camera.intrinsics.x_axis.x.min(camera.intrinsics.y_axis.y);
            (z > 0.0).then(|| z * extent.farthest(pixel) / focal)
        })
        .collect();
    radii.sort_by(f64::total_cmp);
    match radii.get(radii.len() / 2) {
        Some(&radius) if radius.is_finite() && radius > 0.0 => Ok(Bounds::cube(center, 1.25 * radius)),
        _ => Err(NormalisationError::BehindCameras.into()),
    }
}

/// Where a mask's object pixels lie.
struct Extent {
    centroid: DVec2,
    low: DVec2,
    high: DVec2,
}

impl Extent {
    fn of(mask: &Mask) -> Self {
        let (mut sum, mut count) = (DVec2::ZERO, 0.0);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for (u, v, _) in mask.coverage.enumerate_pixels().filter(|&(u, v, _)| mask.is_object(u, v)) {
            let corner = DVec2::new(f64::from(u), f64::from(v));
            sum += corner + 0.5;
            count += 1.0;
            low = low.min(corner);
            high = high.max(corner + 1.0);
        }
        Self { centroid: sum / count, low, high }
    }

    /// The largest distance from a pixel to a side of the object's pixel box.
    fn farthest(&self, pixel: DVec2) -> f64 {
        (pixel - self.low).abs().max((self.high - pixel).abs()).max_element()
    }
}

/// The point with the least sum of distances to the lines, by reweighted least squares, so that a few wrong lines do
/// not move it much. `None` where the lines are parallel.
fn nearest_to_rays(rays: &[(DVec3, DVec3)]) -> Option<DVec3> {
    let across = |direction: DVec3| {
        DMat3::IDENTITY - DMat3::from_cols(direction * direction.x, direction * direction.y, direction * direction.z)
    };
    // Distances from the cameras' middle: coordinates may be large against the scene.
    let middle = rays.iter().map(|ray| ray.0).sum::<DVec3>() / rays.len() as f64;
    let spread = rays.iter().map(|ray| (ray.0 - middle).length()).fold(0.0, f64::max);
    let mut weights = vec![1.0; rays.len()];
    let mut point = DVec3::ZERO;
    for _ in 0..30 {
        let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for ((origin, direction), weight) in rays.iter().zip(&weights) {
            let projector = across(*direction) * *weight;
            normal += projector;
            right += projector * (*origin - middle);
        }
        let total: f64 = weights.iter().sum();
        let spread_of_directions = (normal * total.recip()).determinant();
        if spread_of_directions.is_nan() || spread_of_directions < 1e-8 {
            return None;
        }
        point = normal.inverse() * right;
        for ((origin, direction), weight) in rays.iter().zip(&mut weights) {
            let distance = (across(*direction) * (point + middle - *origin)).length();
            *weight = (distance + 1e-3 * spread).recip() * spread;
        }
    }
    let center = point + middle;
    center.is_finite().then_some(center)
}

/// The error for masks that agree nowhere: names the views that are farthest from the first consensus found.
fn disagreement(silhouettes: &[Silhouette], region: Bounds, shown: &[usize]) -> Result<NormalisationError> {
    let views = silhouettes.len();
    let mut odd: Vec<usize> = Vec::new();
    for max_disagreeing in 0..views.saturating_sub(1) {
        let settings = HullSettings { max_disagreeing, min_seeing: 2, ..HullSettings::default() };
        let hull = VisualHull::carve_silhouettes(silhouettes, region, SEARCH_RESOLUTION, &settings)?;
        if hull.is_empty() {
            continue;
        }
        let mut ranked: Vec<(f64, usize)> =
            rejected(silhouettes, &hull, &settings).into_iter().zip(shown.iter().copied()).collect();
        ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        odd = ranked.into_iter().take_while(|(share, _)| *share > 0.25).map(|(_, view)| view).take(5).collect();
        odd.sort_unstable();
        break;
    }
    Ok(NormalisationError::Disagreement { views, odd })
}
