//! Where the rays of a picture pass through the visual hull.

use glam::Vec3;

use super::picture::Picture;
use crate::occupancy::OccupancyBitmask;

/// The visual hull as distances at the nodes of a grid, positive inside.
pub(super) struct Hull<'a> {
    pub bitmask: OccupancyBitmask,
    pub values: &'a [f32],
}

impl Hull<'_> {
    /// The distance at a point, positive inside.
    pub fn at(&self, point: Vec3) -> f32 {
        self.bitmask.grid().value(self.values, point)
    }

    /// The z-depths at which a pixel's ray enters and leaves the hull; the first larger where it misses.
    pub fn range(&self, picture: &Picture, pixel: usize) -> [f32; 2] {
        const NONE: [f32; 2] = [1.0, 0.0];
        if !picture.is_object(pixel) {
            return NONE;
        }
        let (origin, direction) = (picture.camera.center, picture.direction(pixel));
        let crossing = |from, along| self.bitmask.first_crossing(self.values, from, along, 0.0, f32::INFINITY);
        let Some(near) = crossing(origin, direction) else { return NONE };
        let beyond = 2.0 * origin.length() + 2.0;
        crossing(origin + beyond * direction, -direction).map_or(NONE, |back| [near, (beyond - back).max(near)])
    }
}
