//! The search for the hull: coarse carving, growing and shrinking, and which of the hulls found is believed.

use glam::DVec3;

use super::bounds::Bounds;
use super::consistency::{rejected, unexplained};
use super::settings::HullSettings;
use super::silhouette::Silhouette;
use super::visual_hull::VisualHull;
use crate::error::{Result, name_views};

/// Voxels along an edge while searching.
pub(super) const SEARCH_RESOLUTION: usize = 48;

/// How often the region may double where the hull touches its border.
const MAX_GROWTHS: usize = 5;

/// How often the region is drawn tighter around the hull.
const MAX_SHRINKS: usize = 12;

/// A hull is believed when half of the views have less of their mask unexplained by it than this.
const TOLERATED_UNEXPLAINED: f64 = 0.05;

/// How much more of the masks, on average, may stay unexplained for the sake of a hull that more views see.
const PRICE_OF_VISIBILITY: f64 = 0.002;

/// A hull is looked at no coarser than this many of its voxels.
const MOST_BLUR: f64 = 2.5;

/// A place that fewer of all views than one in so many see is no part of the region.
const SEEN_BY_ONE_IN: usize = 10;

/// A hull that was found, and how well it does.
pub(super) struct Found {
    pub(super) hull: VisualHull,
    pub(super) settings: HullSettings,
    /// Whether the hull touched the region even when that had grown as far as it may.
    open: bool,
    /// Share of each view's mask that the hull does not explain.
    unexplained: Vec<f64>,
}

/// The strictest hull that explains the masks, or else the one that explains them best.
pub(super) fn search(silhouettes: &[Silhouette], region: Bounds) -> Result<Option<Found>> {
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

/// Among the hulls seen by all, three quarters, half, a quarter or a tenth of the views (by two at least), the first that
/// explains the masks about as well as any. Hulls without end count only where there is no other.
fn best_visibility(silhouettes: &[Silhouette], region: Bounds, max_disagreeing: usize) -> Result<Option<Found>> {
    let views = silhouettes.len();
    let mean = |found: &Found| found.unexplained.iter().sum::<f64>() / views as f64;
    // Where some may disagree, they need not see the object either.
    let mut numbers =
        [views, (3 * views).div_ceil(4), views.div_ceil(2), views.div_ceil(4), views.div_ceil(SEEN_BY_ONE_IN)]
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
    let missed = missed_alike(silhouettes, &found);
    let least = missed.iter().copied().fold(f64::INFINITY, f64::min);
    Ok(found.into_iter().zip(missed).find(|(_, missed)| *missed <= least + PRICE_OF_VISIBILITY).map(|(found, _)| found))
}

/// What each hull leaves unexplained of the masks, on average over the views, looked at as coarsely for all of them: a
/// hull with spurs has large voxels, which hide that masks or cameras are off by a few pixels.
fn missed_alike(silhouettes: &[Silhouette], found: &[Found]) -> Vec<f64> {
    let edge = |found: &Found| found.hull.voxel_size().max_element();
    let widest = found.iter().map(edge).fold(0.0, f64::max);
    let missed = |found: &Found| {
        let width = DVec3::splat(widest.min(MOST_BLUR * edge(found)));
        unexplained(silhouettes, &found.hull, width).iter().sum::<f64>() / silhouettes.len() as f64
    };
    found.iter().map(missed).collect()
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
    let unexplained = unexplained(silhouettes, &hull, hull.voxel_size());
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
pub(super) fn tightened(hull: &VisualHull) -> Option<Bounds> {
    let (found, voxel) = (hull.bounding_box()?, hull.voxel_size());
    Some(Bounds { min: (found.min - voxel).max(hull.bounds().min), max: (found.max + voxel).min(hull.bounds().max) })
}

impl Found {
    /// Median over the views of the share of the mask that the hull does not explain.
    pub(super) fn typically_unexplained(&self) -> f64 {
        let mut shares = self.unexplained.clone();
        shares.sort_by(f64::total_cmp);
        shares[shares.len() / 2]
    }

    pub(super) fn warnings(&self, silhouettes: &[Silhouette], shown: &[usize]) -> Vec<String> {
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
    unexplained(silhouettes, hull, hull.voxel_size()).into_iter().zip(rejected).map(|(a, b)| a.max(b)).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use image::{GrayImage, Luma};

    use super::*;
    use crate::camera::Camera;
    use crate::raster::Mask;

    /// Views of a thin plate, whose masks are a pixel off to one side or the other.
    fn plate() -> Vec<(Camera, Mask)> {
        let half = DVec3::new(0.5, 0.3, 0.01);
        let view = |i: usize| {
            let height = 1.0 - (2.0 * i as f64 + 1.0) / 24.0;
            let (sin, cos) = (2.4 * i as f64).sin_cos();
            let radius = (1.0 - height * height).sqrt();
            let eye = 2.0 * DVec3::new(cos * radius, height, sin * radius);
            let camera = Camera::look_at(120, 120, 180.0, eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0));
            let coverage = GrayImage::from_fn(120, 120, |u, v| {
                let aside = if i.is_multiple_of(2) { 1.5 } else { -0.5 };
                let ray = camera.ray(DVec2::new(f64::from(u) + aside, f64::from(v) + 0.5));
                let (a, b) = ((-half - ray.origin) / ray.direction, (half - ray.origin) / ray.direction);
                Luma([if a.min(b).max_element() <= a.max(b).min_element() { 255 } else { 0 }])
            });
            (camera, Mask::from(coverage))
        };
        (0..24).map(view).collect()
    }

    #[test]
    fn a_hull_in_a_tight_box_counts_as_the_same_hull_in_a_wide_one() {
        let views = plate();
        let views: Vec<(&Camera, &Mask)> = views.iter().map(|(camera, mask)| (camera, mask)).collect();
        let silhouettes = Silhouette::all(&views).unwrap();
        let found = |reach: DVec3| {
            let settings = HullSettings::default();
            let bounds = Bounds { min: -reach, max: reach };
            let hull = VisualHull::carve_silhouettes(&silhouettes, bounds, SEARCH_RESOLUTION, &settings).unwrap();
            let unexplained = unexplained(&silhouettes, &hull, hull.voxel_size());
            Found { hull, settings, open: false, unexplained }
        };
        let both = [found(DVec3::new(0.55, 0.35, 0.07)), found(DVec3::new(0.55, 0.35, 0.4))];
        let mean = |found: &Found| found.unexplained.iter().sum::<f64>() / views.len() as f64;
        let [tight, wide] = both.each_ref().map(mean);
        assert!(tight > wide + PRICE_OF_VISIBILITY, "by their own voxels {tight} and {wide}");
        let missed = missed_alike(&silhouettes, &both);
        assert!(missed[0] <= missed[1] + PRICE_OF_VISIBILITY, "alike {missed:?}");
        // What is not there is missed all the same.
        let half = found(DVec3::new(0.25, 0.35, 0.07));
        let missed = missed_alike(&silhouettes, &[half, found(DVec3::new(0.55, 0.35, 0.4))]);
        assert!(missed[0] > 0.2, "half of the plate {missed:?}");
    }
}
