//! Boxes of the hierarchy, and the test whether a ray enters one.

use glam::{Vec3, Vec3A, Vec4};

use crate::ray::Ray;

/// A box around triangles, as two aligned vectors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    /// The low corner, and the bits of the first triangle of a leaf, or of the first child of an inner node.
    low: Vec4,
    /// The high corner, and the bits of the number of triangles of a leaf; 0 for an inner node.
    high: Vec4,
}

impl Node {
    pub(super) fn new(low: Vec3, high: Vec3, first: u32, count: u32) -> Self {
        Self { low: low.extend(f32::from_bits(first)), high: high.extend(f32::from_bits(count)) }
    }

    /// The inner node of two children, the first of which lies at this place.
    pub(super) fn around(left: &Self, right: &Self, first: u32) -> Self {
        Self::new(left.low().min(right.low()), left.high().max(right.high()), first, 0)
    }

    pub(super) fn low(&self) -> Vec3 {
        self.low.truncate()
    }

    pub(super) fn high(&self) -> Vec3 {
        self.high.truncate()
    }

    /// First triangle of a leaf, or first child of an inner node.
    pub(super) fn first(&self) -> u32 {
        self.low.w.to_bits()
    }

    /// Triangles of a leaf; 0 for an inner node.
    pub(super) fn count(&self) -> u32 {
        self.high.w.to_bits()
    }
}

/// The slab test against boxes, with what depends on the ray alone worked out.
///
/// In single precision, three axes at once: boxes are taken to be larger than they are by more than rounding moves them, so
/// that none is lost that the exact test of its triangles might find a hit in (after Ize 2013). Positions are relative to the
/// middle of all boxes, where they have most digits, and depths are along a direction whose largest component is one.
pub(super) struct Slabs {
    middle: Vec3A,
    /// The ray's origin, farther on and farther back by what rounding may do.
    origin: [Vec3A; 2],
    inverse: Vec3A,
    /// From the ray's depths to those here.
    scale: f64,
}

/// What rounding may do, as a share of the largest number that is rounded: a position, the same with this margin, a difference,
/// an inverse and a product have half of `f32::EPSILON` each.
const ROUNDING: f32 = 4.0 * f32::EPSILON;

impl Slabs {
    /// Of a ray with a direction, through the tree of this root, whose corners are finite.
    pub(super) fn new(ray: &Ray, root: &Node) -> Self {
        let (low, high) = (Vec3A::from_vec4(root.low), Vec3A::from_vec4(root.high));
        let middle = 0.5 * low + 0.5 * high;
        let origin = (ray.origin - middle.as_dvec3()).as_vec3a();
        let reach = origin.abs() + (high - middle).max(middle - low);
        // Along no axis nothing: a ray moves on by less along an axis where its inverse is cut off.
        let margin = ROUNDING * reach.max(Vec3A::splat(f32::EPSILON * reach.max_element()));
        let scale = ray.direction.abs().max_element();
        // Finite along an axis that the ray does not move on, where 0 * inf would be no number.
        let largest = Vec3A::splat(f32::MAX.sqrt());
        let inverse = (ray.direction / scale).recip().as_vec3a().clamp(-largest, largest);
        Self { middle, origin: [origin + margin, origin - margin], inverse, scale }
    }

    /// A range of the ray's depths in those here, no smaller than it is.
    pub(super) fn range(&self, min_depth: f64, max_depth: f64) -> [f32; 2] {
        let [min, max] = [min_depth, max_depth].map(|depth| (depth * self.scale) as f32);
        [min.next_down(), max.next_up()]
    }

    /// A depth no larger than that at which the box is entered, or `None` where it is missed within the range.
    pub(super) fn entry(&self, node: &Node, range: [f32; 2]) -> Option<f32> {
        let low = (Vec3A::from_vec4(node.low) - self.middle - self.origin[0]) * self.inverse;
        let high = (Vec3A::from_vec4(node.high) - self.middle - self.origin[1]) * self.inverse;
        let entry = low.min(high).max_element().max(range[0]);
        let exit = low.max(high).min_element().min(range[1]);
        (entry <= exit).then_some(entry)
    }
}
