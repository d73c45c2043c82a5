//! Where the object is: from cameras of any units to the unit cube.

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::bounds::Bounds;
use super::consistency::{rejected, unexplained};
use super::settings::HullSettings;
use super::silhouette::Silhouette;
use super::visual_hull::VisualHull;
use crate::camera::{Camera, Similarity};
use crate::error::{NormalisationError, Result, name_views};
use crate::raster::Mask;

/// Edge of the object's box in the unit cube; the rest keeps the surface off the faces while it is learned.
const OBJECT_EDGE: f64 = 0.9;

/// Voxels along an edge while searching, and for the box that is returned.
const SEARCH_RESOLUTION: usize = 48;
const FINAL_RESOLUTION: usize = 128;

/// How often the region may double where the hull touches its border.
const MAX_GROWTHS: usize = 5;

/// How often the region is drawn tighter around the hull.
const MAX_SHRINKS: usize = 12;

/// A hull is believed when half of the views have less of their mask unexplained by it than this.
const TOLERATED_UNEXPLAINED: f64 = 0.05;

/// How much more of the masks, on average, may stay unexplained for the sake of a hull that more views see.
const PRICE_OF_VISIBILITY: f64 = 0.002;

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
    pub(super) fn of_bounds(bounds: Bounds, warnings: Vec<String>) -> Self {
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
/// half, ...): otherwise the hull of an object that leaves the pictures would have spurs to infinity, where no other
/// view looks. If the strict hull explains the masks badly, some views are allowed to disagree, and a warning names
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

/// A hull that was found, and how well it does.
struct Found {
    hull: VisualHull,
    settings: HullSettings,
    /// Whether the hull touched the region even when that had grown as far as it may.
    open: bool,
    /// Share of each view's mask that the hull does not explain.
    unexplained: Vec<f64>,
}

/// The strictest hull that explains the masks, or else the one that explains them best.
fn search(silhouettes: &[Silhouette], region: Bounds) -> Result<Option<Found>> {
    let mut best: Option<Found> = None;
    for max_disagreeing in tolerances(silhouettes.len()) {
        let Some(found) = best_visibility(silhouettes, region, max_disagreeing)? else { continue };
        let unexplained = found.typically_unexplained();
        if best.as_ref().is_none_or(|best| unexplained < best.typically_unexplained()) {
            best = Some(found);
        }
        if unexplained < TOLERATED_UNEXPLAINED {
            break;
        }
    }
    Ok(best)
}

/// How many views may disagree: none, then more, up to a quarter of them.
fn tolerances(views: usize) -> impl Iterator<Item = usize> {
    [0, 1, 2, 4, 8, 16, 32].into_iter().filter(move |&k| k == 0 || 4 * k <= views)
}

/// Among the hulls seen by all, three quarters, half, a quarter of the views or by two, the first that explains the
/// masks about as well as any. Hulls without end count only where there is no other.
fn best_visibility(silhouettes: &[Silhouette], region: Bounds, max_disagreeing: usize) -> Result<Option<Found>> {
    let views = silhouettes.len();
    let mean = |found: &Found| found.unexplained.iter().sum::<f64>() / views as f64;
    // Where some may disagree, they need not see the object either.
    let mut numbers = [views, (3 * views).div_ceil(4), views.div_ceil(2), views.div_ceil(4), 2]
        .map(|seeing| seeing.saturating_sub(max_disagreeing).max(2))
        .to_vec();
    numbers.dedup();
    let mut found: Vec<Found> = Vec::new();
    for min_seeing in numbers {
        let settings = HullSettings { max_disagreeing, min_seeing, ..HullSettings::default() };
        found.extend(locate(silhouettes, region, settings)?);
        if found.last().is_some_and(|found| !found.open && mean(found) <= PRICE_OF_VISIBILITY) {
            break; // No other can be better by more than the price.
        }
    }
    if found.iter().any(|found| !found.open) {
        found.retain(|found| !found.open);
    }
    let least = found.iter().map(mean).fold(f64::INFINITY, f64::min);
    Ok(found.into_iter().find(|found| mean(found) <= least + PRICE_OF_VISIBILITY))
}

/// Carves coarsely, growing and shrinking the region to the hull; `None` where nothing is left.
fn locate(silhouettes: &[Silhouette], start: Bounds, settings: HullSettings) -> Result<Option<Found>> {
    let carve = |region| VisualHull::carve_silhouettes(silhouettes, region, SEARCH_RESOLUTION, &settings);
    let mut hull = carve(start)?;
    for _ in 0..MAX_GROWTHS {
        let Some(region) = grown(&hull) else { break };
        hull = carve(region)?;
    }
    let open = grown(&hull).is_some();
    if open {
        // Nothing bounds the hull on some side: stay with what the masks' extents say.
        hull = carve(start)?;
    }
    for _ in 0..MAX_SHRINKS {
        let Some(region) = tightened(&hull) else { return Ok(None) };
        let settled = (region.size() / hull.bounds().size()).min_element() > 0.85;
        hull = carve(region)?;
        if settled {
            break;
        }
    }
    let unexplained = unexplained(silhouettes, &hull);
    Ok((!hull.is_empty()).then_some(Found { hull, settings, open, unexplained }))
}

/// The region doubled on the sides where the hull touches its border; `None` where it touches none.
fn grown(hull: &VisualHull) -> Option<Bounds> {
    let found = hull.bounding_box()?;
    let (mut grown, size) = (hull.bounds(), hull.bounds().size());
    let half_voxel = 0.5 * hull.voxel_size();
    for axis in 0..3 {
        if found.min[axis] < hull.bounds().min[axis] + half_voxel[axis] {
            grown.min[axis] -= size[axis];
        }
        if found.max[axis] > hull.bounds().max[axis] - half_voxel[axis] {
            grown.max[axis] += size[axis];
        }
    }
    (grown != hull.bounds()).then_some(grown)
}

/// The hull's box and one voxel more on every side, within the region.
fn tightened(hull: &VisualHull) -> Option<Bounds> {
    let (found, voxel) = (hull.bounding_box()?, hull.voxel_size());
    Some(Bounds { min: (found.min - voxel).max(hull.bounds().min), max: (found.max + voxel).min(hull.bounds().max) })
}

impl Found {
    /// Median over the views of the share of the mask that the hull does not explain.
    fn typically_unexplained(&self) -> f64 {
        let mut shares = self.unexplained.clone();
        shares.sort_by(f64::total_cmp);
        shares[shares.len() / 2]
    }

    fn warnings(&self, silhouettes: &[Silhouette], shown: &[usize]) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.open {
            warnings.push(
                "the masks do not bound the object on every side; the box is a guess from the masks' sizes".to_owned(),
            );
        }
        let unexplained = self.typically_unexplained();
        if unexplained >= TOLERATED_UNEXPLAINED {
            warnings.push(format!(
                "in half of the views, no shape explains more than {:.0} % of the mask",
                100.0 * (1.0 - unexplained)
            ));
        }
        let odd: Vec<usize> = disagreements(silhouettes, &self.hull, &self.settings)
            .into_iter()
            .zip(shown)
            .filter(|&(share, _)| share > 0.25)
            .map(|(_, &view)| view)
            .collect();
        if !odd.is_empty() {
            warnings
                .push(format!("{} with the others: check mask and camera", name_views(&odd, "disagrees", "disagree")));
        } else if self.settings.max_disagreeing > 0 {
            warnings.push(format!(
                "the masks only agree when {} of {} views may be wrong at any point",
                self.settings.max_disagreeing,
                shown.len()
            ));
        }
        warnings
    }
}

/// How much each view disagrees with a hull: the part of its mask that the hull does not explain, or the part of the
/// hull that it sees as background, whichever is more.
fn disagreements(silhouettes: &[Silhouette], hull: &VisualHull, settings: &HullSettings) -> Vec<f64> {
    let rejected = rejected(silhouettes, hull, settings);
    unexplained(silhouettes, hull).into_iter().zip(rejected).map(|(a, b)| a.max(b)).collect()
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
