//! Plane sweep: how well each pixel of a view matches its neighbours at each depth that the hull allows.

use pulp::Arch;

use super::correlation::{Space, correlate, warp};
use super::cost_volume::{CostVolume, Part};
use super::depth_map::DepthMap;
use super::hull::Hull;
use super::picture::Picture;
use super::semi_global;

/// The least sine of an angle between neighbours that sets the distance of planes.
const LEAST_ANGLE: f32 = 0.05;

/// The depths of a view.
pub(super) fn depth_map(pictures: &[Picture], view: usize, neighbours: &[usize], hull: &Hull) -> DepthMap {
    let picture = &pictures[view];
    let mut map = DepthMap::unknown(picture.width * picture.height);
    let ranges: Vec<[f32; 2]> = (0..map.hull.len()).map(|pixel| hull.range(picture, pixel)).collect();
    // From plane to plane, a point moves by about a pixel in the neighbour that sees it move most.
    let toward = picture.camera.center.normalize_or_zero();
    let widest = (neighbours.iter())
        .map(|&other| toward.angle_between(pictures[other].camera.center.normalize_or_zero()).sin())
        .fold(LEAST_ANGLE, f32::max);
    // Two neighbours must match.
    let Some((mut volume, part)) = CostVolume::new(picture, &ranges, widest).filter(|_| neighbours.len() > 1) else {
        return map;
    };
    sweep(&mut volume, &part, picture, pictures, neighbours);
    let aggregated = semi_global::aggregate(&volume);
    for pixel in 0..volume.width * volume.height {
        let Some((depth, confidence)) = volume.best(&aggregated, pixel) else { continue };
        let at = part.pixel(pixel, picture);
        map.z_depth[at] = depth;
        map.confidence[at] = confidence;
        map.hull[at] = ranges[at][0];
    }
    map
}

/// Fills in the costs: one less the mean of the two best correlations with neighbours, since some do not see a place.
fn sweep(volume: &mut CostVolume, part: &Part, picture: &Picture, pictures: &[Picture], neighbours: &[usize]) {
    let arch = Arch::new();
    let mut space = Space::new(part);
    for plane in 0..volume.planes {
        let depth = volume.near + plane as f32 * volume.step;
        let Some(rows) = volume.rows_at(plane) else { continue };
        space.best.fill([-1.0; 2]);
        for &other in neighbours {
            warp(picture, &pictures[other], depth, part, rows, &mut space);
            arch.dispatch(|| correlate(volume, rows, &mut space));
        }
        for pixel in rows[0] * part.width..rows[1] * part.width {
            let [best, second] = space.best[pixel];
            if second > -1.0 && volume.may_lie(pixel, plane) {
                volume.costs[pixel * volume.planes + plane] = 1.0 - 0.5 * (best + second);
            }
        }
    }
}
