//! Boxes of the hierarchy, and the test whether a ray enters one.

use glam::{DVec3, Vec3};

use crate::ray::Ray;

/// A box around triangles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) low: Vec3,
    pub(super) high: Vec3,
    /// First triangle of a leaf, or first child of an inner node.
    pub(super) first: u32,
    /// Triangles of a leaf; 0 for an inner node.
    pub(super) count: u32,
}

/// The slab test against boxes, with what depends on the ray alone worked out.
pub(super) struct Slabs {
    origin: DVec3,
    inverse: DVec3,
}

impl Slabs {
    pub(super) fn new(ray: &Ray) -> Self {
        Self { origin: ray.origin, inverse: ray.direction.recip() }
    }

    /// The ray depth at which the box is entered, or `None` where it is missed within the range.
    pub(super) fn entry(&self, node: &Node, min_depth: f64, max_depth: f64) -> Option<f64> {
        // Rounding must not lose a box that is only touched (Ize 2013).
        const GUARD: f64 = 1.0 + 4.0 * f64::EPSILON;
        let (mut entry, mut exit) = (min_depth, max_depth);
        for axis in 0..3 {
            let (low, high) = (f64::from(node.low[axis]), f64::from(node.high[axis]));
            let (near, far) = if self.inverse[axis] < 0.0 { (high, low) } else { (low, high) };
            // A ray within a face's plane gives 0 * inf = NaN, which `max` and `min` pass over: it counts as inside.
            entry = entry.max((near - self.origin[axis]) * self.inverse[axis]);
            exit = exit.min((far - self.origin[axis]) * self.inverse[axis] * GUARD);
        }
        (entry <= exit).then_some(entry)
    }
}
