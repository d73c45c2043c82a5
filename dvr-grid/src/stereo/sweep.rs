//! Plane sweep: how well each pixel of a view matches its neighbours at each depth that the hull allows.

use pulp::Arch;

use super::correlation::{Match, Space};
use super::cost_volume::{CostVolume, Part, UNKNOWN};
use super::depth_map::DepthMap;
use super::hull::Hull;
use super::picture::Picture;
use super::semi_global;

/// The least sine of an angle between neighbours that sets the distance of planes.
const LEAST_ANGLE: f32 = 0.05;

/// Planes whose costs are written to the volume together: those of a pixel lie in a cache line or two.
const TOGETHER: usize = 16;

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
    let (mut space, windows) = (Space::new(part), volume.windows());
    // Costs of the pixels of one plane lie side by side; in the volume, those of the planes of one pixel do.
    let mut planes: [Vec<f32>; TOGETHER] = std::array::from_fn(|_| vec![UNKNOWN; part.width * part.height]);
    for first in (0..volume.planes).step_by(TOGETHER) {
        for ((plane, window), costs) in (first..).zip(&windows[first..]).zip(&mut planes) {
            let Some(window) = *window else { continue };
            window.rows_in(part.width).for_each(|pixels| space.best[pixels].fill([-1.0; 2]));
            let depth = volume.near + plane as f32 * volume.step;
            for &other in neighbours {
                let (other, space) = (&pictures[other], &mut space);
                arch.dispatch(Match { volume, part, own: picture, other, depth, window, space });
            }
            for pixels in window.rows_in(part.width) {
                for (cost, &[best, second]) in costs[pixels.clone()].iter_mut().zip(&space.best[pixels]) {
                    *cost = if second > -1.0 { 1.0 - 0.5 * (best + second) } else { UNKNOWN };
                }
            }
        }
        (0..part.width * part.height).for_each(|pixel| {
            let (of_pixel, at) = volume.planes_of(pixel);
            let together = of_pixel.start.max(first)..of_pixel.end.min(first + TOGETHER);
            for plane in together {
                volume.costs[at.start + plane - of_pixel.start] = planes[plane - first][pixel];
            }
        });
    }
}
