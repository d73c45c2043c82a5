//! Top-down construction by the binned surface area heuristic (Wald 2007).

use glam::Vec3;

use super::node::Node;

/// Triangles a leaf may hold before a split is tried.
const LEAF_SIZE: usize = 4;
/// Candidate planes of a split are the borders between this many bins.
const BINS: usize = 16;
/// Below this depth nodes are halved by count, so that no input makes the tree deeper than the traversal's stack.
pub(super) const MAX_SAH_DEPTH: usize = 32;

/// A face while the tree is built.
#[derive(Clone, Copy)]
pub(super) struct Primitive {
    pub(super) face: u32,
    low: Vec3,
    high: Vec3,
    center: Vec3,
}

impl Primitive {
    pub(super) fn new(face: u32, [a, b, c]: [Vec3; 3]) -> Self {
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        Self { face, low, high, center: 0.5 * (low + high) }
    }
}

/// The tree so far: its nodes, and the faces in the order of its leaves.
pub(super) struct Builder {
    pub(super) nodes: Vec<Node>,
    pub(super) primitives: Vec<Primitive>,
    /// The second half of a split while the first is brought together.
    pub(super) second: Vec<Primitive>,
}

impl Builder {
    /// Makes `node` hold the primitives `first..end`, and splits them while that pays.
    pub(super) fn build(&mut self, node: usize, first: usize, end: usize, depth: usize) {
        let primitives = &self.primitives[first..end];
        let low = primitives.iter().fold(Vec3::INFINITY, |low, p| low.min(p.low));
        let high = primitives.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(p.high));
        self.nodes[node] = Node { low, high, first: first as u32, count: (end - first) as u32 };
        if end - first <= LEAF_SIZE {
            return;
        }
        let middle = first + self.split(first, end, depth);
        let child = self.nodes.len();
        self.nodes.extend([self.nodes[node]; 2]);
        self.nodes[node].first = child as u32;
        self.nodes[node].count = 0;
        self.build(child, first, middle, depth + 1);
        self.build(child + 1, middle, end, depth + 1);
    }

    /// Orders the primitives so that the two halves are apart, and says how many the first has; never none or all.
    fn split(&mut self, first: usize, end: usize, depth: usize) -> usize {
        let primitives = &mut self.primitives[first..end];
        let low = primitives.iter().fold(Vec3::INFINITY, |low, p| low.min(p.center));
        let high = primitives.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(p.center));
        let plane = if depth < MAX_SAH_DEPTH { best_plane(primitives, low, high) } else { None };
        let Some((axis, bin)) = plane else {
            // Too deep, or all in one place: halve along the longest axis.
            let axis = (high - low).max_position();
            let half = primitives.len() / 2;
            primitives.select_nth_unstable_by(half, |a, b| {
                a.center[axis].total_cmp(&b.center[axis]).then(a.face.cmp(&b.face))
            });
            return half;
        };
        // In their order, so that equal meshes give equal trees on every machine.
        self.second.clear();
        let mut half = 0;
        for i in 0..primitives.len() {
            let primitive = primitives[i];
            if bin_of(&primitive, axis, low, high) <= bin {
                primitives[half] = primitive;
                half += 1;
            } else {
                self.second.push(primitive);
            }
        }
        primitives[half..].copy_from_slice(&self.second);
        half
    }
}

fn bin_of(primitive: &Primitive, axis: usize, low: Vec3, high: Vec3) -> usize {
    let position = (primitive.center[axis] - low[axis]) / (high[axis] - low[axis]);
    ((position * BINS as f32) as usize).min(BINS - 1)
}

/// The axis, and the last bin of the first half, for which rays are expected to meet the fewest triangles.
fn best_plane(primitives: &[Primitive], low: Vec3, high: Vec3) -> Option<(usize, usize)> {
    let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY, 0usize);
    let area = |(low, high, _): &(Vec3, Vec3, usize)| {
        let e = *high - *low;
        e.x * e.y + e.y * e.z + e.z * e.x
    };
    let mut best: Option<(f32, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| high[axis] > low[axis]) {
        let mut bins = [empty; BINS];
        for primitive in primitives {
            let bin = &mut bins[bin_of(primitive, axis, low, high)];
            *bin = (bin.0.min(primitive.low), bin.1.max(primitive.high), bin.2 + 1);
        }
        let merge = |a: (Vec3, Vec3, usize), b: (Vec3, Vec3, usize)| (a.0.min(b.0), a.1.max(b.1), a.2 + b.2);
        // Cost of everything right of each border, then swept from the left.
        let mut right_costs = [0.0; BINS];
        let mut right = empty;
        for bin in (1..BINS).rev() {
            right = merge(right, bins[bin]);
            right_costs[bin - 1] = if right.2 > 0 { area(&right) * right.2 as f32 } else { f32::INFINITY };
        }
        let mut left = empty;
        for bin in 0..BINS - 1 {
            left = merge(left, bins[bin]);
            let cost = if left.2 > 0 { area(&left) * left.2 as f32 + right_costs[bin] } else { f32::INFINITY };
            if cost.is_finite() && best.is_none_or(|b| cost < b.0) {
                best = Some((cost, axis, bin));
            }
        }
    }
    best.map(|(_, axis, bin)| (axis, bin))
}
