//! Top-down construction by the binned surface area heuristic (Wald 2007).

use glam::Vec3;

use super::node::Node;

/// Triangles a leaf may hold before a split is tried.
const LEAF_SIZE: usize = 4;
/// Candidate planes of a split are the borders between this many bins.
const BINS: usize = 16;
/// Triangles up to which one thread builds a part of the tree.
const ALONE: usize = 1 << 13;
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

/// A tree whose root comes first; the children of an inner node lie side by side, and leaves name their primitives by place.
pub(super) fn build(primitives: &mut [Primitive]) -> Vec<Node> {
    let mut builder = Builder { nodes: Vec::with_capacity(primitives.len().max(1)), second: Vec::new() };
    builder.nodes.push(Node { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, first: 0, count: 0 });
    builder.build(0, primitives, 0, 0);
    builder.nodes
}

/// The tree so far.
struct Builder {
    nodes: Vec<Node>,
    /// The second half of a split while the first is brought together.
    second: Vec<Primitive>,
}

impl Builder {
    /// Makes `node` hold these primitives, the first of which is that of number `first`, and splits them while that pays.
    fn build(&mut self, node: usize, primitives: &mut [Primitive], first: usize, depth: usize) {
        let low = primitives.iter().fold(Vec3::INFINITY, |low, p| low.min(p.low));
        let high = primitives.iter().fold(Vec3::NEG_INFINITY, |high, p| high.max(p.high));
        self.nodes[node] = Node { low, high, first: first as u32, count: primitives.len() as u32 };
        if primitives.len() <= LEAF_SIZE {
            return;
        }
        let half = self.split(primitives, depth);
        let child = self.nodes.len();
        self.nodes.extend([self.nodes[node]; 2]);
        self.nodes[node].first = child as u32;
        self.nodes[node].count = 0;
        let is_large = primitives.len() > ALONE;
        let (left, right) = primitives.split_at_mut(half);
        if is_large {
            // Each half in a tree of its own, as it would be here.
            let apart = |primitives: &mut [Primitive], first: usize| {
                let mut part = Self { nodes: vec![self.nodes[node]], second: Vec::new() };
                part.build(0, primitives, first, depth + 1);
                part.nodes
            };
            let (left, right) = rayon::join(|| apart(left, first), || apart(right, first + half));
            self.graft(child, &left);
            self.graft(child + 1, &right);
        } else {
            self.build(child, left, first, depth + 1);
            self.build(child + 1, right, first + half, depth + 1);
        }
    }

    /// Puts the root of a tree in the place of a node, and the others behind all nodes.
    fn graft(&mut self, node: usize, tree: &[Node]) {
        // The root is at place 0 there, the next node at 1.
        let shift = (self.nodes.len() - 1) as u32;
        for (i, moved) in tree.iter().enumerate() {
            let first = if moved.count == 0 { moved.first + shift } else { moved.first };
            let moved = Node { first, ..*moved };
            if i == 0 { self.nodes[node] = moved } else { self.nodes.push(moved) }
        }
    }

    /// Orders the primitives so that the two halves are apart, and says how many the first has; never none or all.
    fn split(&mut self, primitives: &mut [Primitive], depth: usize) -> usize {
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
