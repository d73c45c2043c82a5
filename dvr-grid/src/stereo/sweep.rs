//! Plane sweep: how well each pixel of a view matches its neighbours at each depth that the hull allows.

use pulp::Arch;

use super::correlation::{Match, Space};
use super::cost_volume::{CostVolume, UNKNOWN, VolumeLayout};
use super::depth_map::DepthMap;
use super::hull::Hull;
use super::picture::Picture;
use super::semi_global;

/// Planes whose costs are written to the volume together: those of a pixel lie in a cache line or two.
const TOGETHER: usize = 16;

/// The depths of a view.
pub(super) fn depth_map(pictures: &[Picture], view: usize, neighbours: &[usize], hull: &Hull) -> DepthMap {
    let picture = &pictures[view];
    let mut map = DepthMap::unknown(picture.width * picture.height);
    let ranges: Vec<[f32; 2]> = (0..map.hull.len()).map(|pixel| hull.range(picture, pixel)).collect();
    let Some(layout) = VolumeLayout::new(pictures, view, neighbours, &ranges) else { return map };
    let part = layout.part;
    let grey = (0..layout.pixels()).map(|i| picture.grey[part.pixel(i, picture)]).collect();
    let mut volume = CostVolume::unknown(layout, grey);
    sweep(&mut volume, picture, pictures, neighbours);
    let aggregated = semi_global::aggregate(&volume);
    for pixel in 0..volume.layout.pixels() {
        let Some((depth, confidence)) = volume.best(&aggregated, pixel) else { continue };
        let at = part.pixel(pixel, picture);
        map.z_depth[at] = depth;
        map.confidence[at] = confidence;
        map.hull[at] = ranges[at][0];
    }
    map
}

/// Fills in the costs: one less the mean of the two best correlations with neighbours, since some do not see a place.
fn sweep(volume: &mut CostVolume, picture: &Picture, pictures: &[Picture], neighbours: &[usize]) {
    let arch = Arch::new();
    let (part, planes) = (volume.layout.part, volume.layout.planes);
    let (mut space, windows) = (Space::new(&part), volume.layout.windows());
    // Costs of the pixels of one plane lie side by side; in the volume, those of the planes of one pixel do.
    let mut costs_of: [Vec<f32>; TOGETHER] = std::array::from_fn(|_| vec![UNKNOWN; part.width * part.height]);
    for first in (0..planes).step_by(TOGETHER) {
        for ((plane, window), costs) in (first..).zip(&windows[first..]).zip(&mut costs_of) {
            let Some(window) = *window else { continue };
            window.rows_in(part.width).for_each(|pixels| space.best[pixels].fill([-1.0; 2]));
            let depth = volume.layout.near + plane as f32 * volume.layout.step;
            for &other in neighbours {
                let (other, space) = (&pictures[other], &mut space);
                arch.dispatch(Match { volume, own: picture, other, depth, window, space });
            }
            for pixels in window.rows_in(part.width) {
                for (cost, &[best, second]) in costs[pixels.clone()].iter_mut().zip(&space.best[pixels]) {
                    *cost = if second > -1.0 { 1.0 - 0.5 * (best + second) } else { UNKNOWN };
                }
            }
        }
        (0..part.width * part.height).for_each(|pixel| {
            let (of_pixel, at) = volume.layout.planes_of(pixel);
            let together = of_pixel.start.max(first)..of_pixel.end.min(first + TOGETHER);
            for plane in together {
                volume.costs[at.start + plane - of_pixel.start] = costs_of[plane - first][pixel];
            }
        });
    }
}
