//! Carving coarse to fine: blocks of voxels that all views agree on are decided at once.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::settings::HullSettings;
use super::silhouette::{Sight, Silhouette};

/// Edge of the largest blocks in voxels.
const BLOCK: usize = 16;

/// What the views say of a box.
enum Verdict {
    Hull,
    Outside,
    /// Neither holds for every point of it.
    Mixed,
}

/// Everything that decides whether a voxel is hull.
pub(super) struct Carver<'a> {
    pub silhouettes: &'a [Silhouette],
    pub settings: &'a HullSettings,
    pub bounds: Bounds,
    pub resolution: usize,
}

impl Carver<'_> {
    /// Sets the voxels that are hull in a grid of `false`, x fastest, then y, then z.
    pub(super) fn carve(&self, occupied: &mut [bool]) {
        let n = self.resolution;
        occupied.par_chunks_mut(n * n * BLOCK).enumerate().for_each(|(i, slab)| {
            let first_layer = i * BLOCK;
            let z = first_layer..first_layer + slab.len() / (n * n);
            for y in (0..n).step_by(BLOCK) {
                for x in (0..n).step_by(BLOCK) {
                    let block = [x..(x + BLOCK).min(n), y..(y + BLOCK).min(n), z.clone()];
                    self.carve_block(slab, first_layer, block);
                }
            }
        });
    }

    /// Carves a block of the slab that begins at `first_layer`.
    fn carve_block(&self, slab: &mut [bool], first_layer: usize, block: [Range<usize>; 3]) {
        let n = self.resolution;
        let voxel = self.bounds.size() / n as f64;
        let span = |f: fn(&Range<usize>) -> f64| DVec3::from_array([0, 1, 2].map(|axis| f(&block[axis])));
        let center = self.bounds.min + voxel * span(|range| 0.5 * (range.start + range.end) as f64);
        let half = voxel * span(|range| 0.5 * range.len() as f64);
        let [x, y, z] = &block;
        let mut fill = |hull: bool| {
            for z in z.clone() {
                for y in y.clone() {
                    let row = ((z - first_layer) * n + y) * n;
                    slab[row + x.start..row + x.end].fill(hull);
                }
            }
        };
        if block.iter().all(|range| range.len() == 1) {
            return fill(self.is_hull(center, if self.settings.conservative { half } else { DVec3::ZERO }));
        }
        match self.verdict(center, half) {
            Verdict::Hull => fill(true),
            Verdict::Outside => {}
            Verdict::Mixed => {
                for octant in 0..8 {
                    let part: [Range<usize>; 3] = std::array::from_fn(|axis| {
                        let Range { start, end } = block[axis];
                        let middle = (start + end).div_ceil(2);
                        if octant & (1 << axis) == 0 { start..middle } else { middle..end }
                    });
                    if part.iter().all(|range| !range.is_empty()) {
                        self.carve_block(slab, first_layer, part);
                    }
                }
            }
        }
    }

    /// Whether the views leave the box `center +- half` in the hull.
    fn is_hull(&self, center: DVec3, half: DVec3) -> bool {
        let (mut seeing, mut disagreeing) = (0, 0);
        for silhouette in self.silhouettes {
            match silhouette.look(center, half, self.settings.margin) {
                Sight::Object => seeing += 1,
                Sight::Unknown => {}
                Sight::Background => {
                    disagreeing += 1;
                    if disagreeing > self.settings.max_disagreeing {
                        return false;
                    }
                }
            }
        }
        seeing >= self.settings.min_seeing
    }

    /// Whether all points of the box are hull, or none is.
    fn verdict(&self, center: DVec3, half: DVec3) -> Verdict {
        let (mut covering, mut ignorant, mut disagreeing) = (0, 0, 0);
        for silhouette in self.silhouettes {
            if silhouette.look(center, half, self.settings.margin) == Sight::Background {
                disagreeing += 1;
                if disagreeing > self.settings.max_disagreeing {
                    return Verdict::Outside;
                }
            } else if silhouette.is_out_of_frame(center, half) {
                ignorant += 1;
            } else if silhouette.is_filled_by_object(center, half) {
                covering += 1;
            }
        }
        let all = covering + ignorant == self.silhouettes.len() && covering >= self.settings.min_seeing;
        if all { Verdict::Hull } else { Verdict::Mixed }
    }
}
