//! A bounding volume hierarchy over triangles: where does a ray first meet a mesh?
//!
//! Built top-down by the binned surface area heuristic (Wald 2007). Triangles are intersected by the watertight test of
//! Woop, Benthin and Wald (2013), in double precision: no ray slips through an edge that two triangles share. Written
//! here because the `bvh` crate's triangle test (Möller and Trumbore) gives no such promise and culls back faces.

use glam::{DVec3, Vec3};

use crate::mesh::Mesh;
use crate::ray::Ray;

/// Triangles a leaf may hold before a split is tried.
const LEAF_SIZE: usize = 4;
/// Candidate planes of a split are the borders between this many bins.
const BINS: usize = 16;
/// Below this depth nodes are halved by count, so that no input makes the tree deeper than the traversal's stack.
const MAX_SAH_DEPTH: usize = 32;
/// `MAX_SAH_DEPTH` and the 32 halvings that a `u32` of triangles allows.
const STACK_SIZE: usize = 64;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Index of the face.
    pub face: u32,
    /// Ray depth, in multiples of the length of the ray's direction.
    pub ray_depth: f64,
    /// Weights of the face's corners at the point that was hit; they sum to one.
    pub barycentric: [f64; 3],
    /// Whether the ray met the side from which the face winds counter-clockwise, the outside.
    pub front: bool,
}

/// A bounding volume hierarchy over a mesh's triangles.
#[derive(Clone, Debug)]
pub struct Bvh {
    /// The root comes first; the children of an inner node lie side by side.
    nodes: Vec<Node>,
    /// Corners, in the order of the leaves.
    triangles: Vec<[Vec3; 3]>,
    /// Face of each triangle.
    faces: Vec<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// First triangle of a leaf, or first child of an inner node.
    first: u32,
    /// Triangles of a leaf; 0 for an inner node.
    count: u32,
}

impl Bvh {
    /// Builds the hierarchy. Faces without area are kept and never hit.
    ///
    /// # Panics
    /// When a face names a vertex that is not there; meshes that were read from files never do.
    pub fn new(mesh: &Mesh) -> Self {
        let mut builder = Builder {
            nodes: Vec::with_capacity(mesh.faces.len().max(1)),
            primitives: (0..mesh.faces.len()).map(|face| Primitive::new(face as u32, mesh.triangle(face))).collect(),
        };
        let count = builder.primitives.len();
        builder.nodes.push(Node { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY, first: 0, count: 0 });
        builder.build(0, 0, count, 0);
        let faces: Vec<u32> = builder.primitives.iter().map(|p| p.face).collect();
        let triangles = faces.iter().map(|&face| mesh.triangle(face as usize)).collect();
        Self { nodes: builder.nodes, triangles, faces }
    }

    /// The first hit with `ray_depth` in `[min_depth, max_depth]`; from both sides of the faces.
    ///
    /// Where two faces are hit at the very same depth (on a shared edge) the one with the smaller index is given.
    pub fn closest_hit(&self, ray: &Ray, min_depth: f64, max_depth: f64) -> Option<RayHit> {
        let mut closest: Option<RayHit> = None;
        self.traverse(ray, min_depth, max_depth, |hit| {
            let nearer = |c: RayHit| hit.ray_depth < c.ray_depth || (hit.ray_depth == c.ray_depth && hit.face < c.face);
            if closest.is_none_or(nearer) {
                closest = Some(hit);
            }
            closest.map_or(max_depth, |c| c.ray_depth)
        });
        closest
    }

    /// Whether anything is hit with `ray_depth` in `[min_depth, max_depth]`: shadows.
    pub fn any_hit(&self, ray: &Ray, min_depth: f64, max_depth: f64) -> bool {
        let mut any = false;
        self.traverse(ray, min_depth, max_depth, |_| {
            any = true;
            f64::NEG_INFINITY
        });
        any
    }

    /// Visits hits, nearer boxes first. `visit` returns up to which depth further hits matter.
    fn traverse(&self, ray: &Ray, min_depth: f64, mut max_depth: f64, mut visit: impl FnMut(RayHit) -> f64) {
        let Some(shear) = Shear::new(ray) else { return };
        let slabs = Slabs::new(ray);
        let mut stack = [(0u32, f64::NEG_INFINITY); STACK_SIZE];
        let mut height = usize::from(slabs.entry(&self.nodes[0], min_depth, max_depth).is_some());
        while height > 0 {
            height -= 1;
            let (index, entry) = stack[height];
            if entry > max_depth {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                for i in node.first..node.first + node.count {
                    let hit = shear.intersect(&self.triangles[i as usize], self.faces[i as usize]);
                    if let Some(hit) = hit.filter(|h| h.ray_depth >= min_depth && h.ray_depth <= max_depth) {
                        max_depth = visit(hit);
                    }
                }
                continue;
            }
            let child = |i: u32| slabs.entry(&self.nodes[i as usize], min_depth, max_depth).map(|entry| (i, entry));
            let (mut near, mut far) = (child(node.first), child(node.first + 1));
            if let (Some(a), Some(b)) = (near, far)
                && a.1 > b.1
            {
                (near, far) = (far, near);
            }
            for next in [far, near].into_iter().flatten() {
                stack[height] = next;
                height += 1;
            }
        }
    }
}

/// A face while the tree is built.
struct Primitive {
    face: u32,
    low: Vec3,
    high: Vec3,
    center: Vec3,
}

impl Primitive {
    fn new(face: u32, [a, b, c]: [Vec3; 3]) -> Self {
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        Self { face, low, high, center: 0.5 * (low + high) }
    }
}

struct Builder {
    nodes: Vec<Node>,
    primitives: Vec<Primitive>,
}

impl Builder {
    /// Makes `node` hold the primitives `first..end`, and splits them while that pays.
    fn build(&mut self, node: usize, first: usize, end: usize, depth: usize) {
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
        // Stable, so that equal meshes give equal trees on every machine.
        primitives.sort_by_key(|p| bin_of(p, axis, low, high) > bin);
        primitives.partition_point(|p| bin_of(p, axis, low, high) <= bin)
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

/// The slab test against boxes, with what depends on the ray alone worked out.
struct Slabs {
    origin: DVec3,
    inverse: DVec3,
}

impl Slabs {
    fn new(ray: &Ray) -> Self {
        Self { origin: ray.origin, inverse: ray.direction.recip() }
    }

    /// The ray depth at which the box is entered, or `None` where it is missed within the range.
    fn entry(&self, node: &Node, min_depth: f64, max_depth: f64) -> Option<f64> {
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

/// A shear that turns the ray into the z axis (Woop et al., section 3.1).
struct Shear {
    origin: DVec3,
    /// The direction's largest component, and the others in an order that keeps the winding.
    axes: [usize; 3],
    shear: DVec3,
}

impl Shear {
    /// `None` for a ray without a direction.
    fn new(ray: &Ray) -> Option<Self> {
        let z = ray.direction.abs().max_position();
        let largest = ray.direction[z];
        if largest == 0.0 || !ray.direction.is_finite() || !ray.origin.is_finite() {
            return None;
        }
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if largest < 0.0 {
            (x, y) = (y, x);
        }
        let shear = DVec3::new(ray.direction[x] / largest, ray.direction[y] / largest, largest.recip());
        Some(Self { origin: ray.origin, axes: [x, y, z], shear })
    }

    fn intersect(&self, corners: &[Vec3; 3], face: u32) -> Option<RayHit> {
        let [x, y, z] = self.axes;
        let relative = corners.map(|corner| corner.as_dvec3() - self.origin);
        let [a, b, c] = relative.map(|p| (p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z]));
        // Scaled barycentrics: the edge that a neighbour shares gives the same number there, with the sign turned.
        let u = c.0 * b.1 - c.1 * b.0;
        let v = a.0 * c.1 - a.1 * c.0;
        let w = b.0 * a.1 - b.1 * a.0;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        let barycentric = [u, v, w].map(|value| value / determinant);
        let depths = relative.map(|p| self.shear.z * p[z]);
        let ray_depth = barycentric.iter().zip(depths).map(|(weight, depth)| weight * depth).sum();
        Some(RayHit { face, ray_depth, barycentric, front: determinant > 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn random_vector(rng: &mut ChaCha8Rng) -> DVec3 {
        DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
    }

    /// Every triangle, one after the other.
    fn closest_by_search(mesh: &Mesh, ray: &Ray) -> Option<RayHit> {
        let shear = Shear::new(ray)?;
        let hits = (0..mesh.faces.len()).filter_map(|f| shear.intersect(&mesh.triangle(f), f as u32));
        hits.filter(|h| h.ray_depth >= 0.0).min_by(|a, b| a.ray_depth.total_cmp(&b.ray_depth).then(a.face.cmp(&b.face)))
    }

    #[test]
    fn the_tree_finds_what_a_search_of_all_triangles_finds() {
        let mesh = shapes::torus(0.6, 0.25, 40, 20);
        let bvh = Bvh::new(&mesh);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut hits = 0;
        for _ in 0..2000 {
            let ray = Ray { origin: random_vector(&mut rng), direction: random_vector(&mut rng) };
            let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY);
            assert_eq!(hit, closest_by_search(&mesh, &ray));
            assert_eq!(bvh.any_hit(&ray, 0.0, f64::INFINITY), hit.is_some());
            hits += usize::from(hit.is_some());
        }
        assert!(hits > 300, "{hits}");
    }

    #[test]
    fn the_hit_lies_on_the_triangle_and_on_the_ray() {
        let mesh = shapes::icosphere(3, 0.5);
        let bvh = Bvh::new(&mesh);
        let ray = Ray { origin: DVec3::new(0.1, 0.2, -2.0), direction: DVec3::new(0.0, 0.0, 0.5) };
        let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY).unwrap();
        let corners = mesh.triangle(hit.face as usize);
        let point: DVec3 = corners.iter().zip(hit.barycentric).map(|(c, w)| c.as_dvec3() * w).sum();
        assert!((point - ray.at(hit.ray_depth)).length() < 1e-12 && hit.front);
        assert!((point.length() - 0.5).abs() < 0.01 && point.z < 0.0);
    }

    #[test]
    fn no_ray_slips_through_an_edge_or_a_corner() {
        // From the centre of a closed surface every ray must hit, above all those through vertices and edges.
        let mesh = shapes::icosphere(2, 0.7);
        let bvh = Bvh::new(&mesh);
        let origin = DVec3::new(0.01, -0.02, 0.03);
        for face in 0..mesh.faces.len() {
            let [a, b, c] = mesh.triangle(face).map(Vec3::as_dvec3);
            for target in [a, b, c, 0.5 * (a + b), 0.25 * b + 0.75 * c, (a + b + c) / 3.0] {
                let ray = Ray { origin, direction: target - origin };
                let hit = bvh.closest_hit(&ray, 0.0, f64::INFINITY).expect("the surface is closed");
                assert!((hit.ray_depth - 1.0).abs() < 1e-9 && !hit.front);
            }
        }
    }

    #[test]
    fn rays_along_the_axes_hit_a_box_also_in_the_plane_of_an_edge() {
        let bvh = Bvh::new(&shapes::cuboid(Vec3::splat(-1.0), Vec3::splat(1.0)));
        for axis in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z] {
            for side in [DVec3::ZERO, axis.any_orthonormal_vector()] {
                let ray = Ray { origin: side - 3.0 * axis, direction: axis };
                assert_eq!(bvh.closest_hit(&ray, 0.0, f64::INFINITY).unwrap().ray_depth, 2.0);
            }
            let beside = Ray { origin: 1.001 * axis.any_orthonormal_vector() - 3.0 * axis, direction: axis };
            assert_eq!(bvh.closest_hit(&beside, 0.0, f64::INFINITY), None);
        }
    }

    #[test]
    fn the_range_of_depths_is_respected() {
        let bvh = Bvh::new(&shapes::cuboid(Vec3::splat(-1.0), Vec3::splat(1.0)));
        let ray = Ray { origin: DVec3::new(0.1, 0.2, -3.0), direction: DVec3::Z };
        assert_eq!(bvh.closest_hit(&ray, 0.0, 1.9), None);
        assert_eq!(bvh.closest_hit(&ray, 2.1, 10.0).unwrap().ray_depth, 4.0);
        assert!(!bvh.any_hit(&ray, 4.1, 10.0) && bvh.any_hit(&ray, 2.5, 4.5));
    }

    #[test]
    fn nothing_and_degenerate_things_are_never_hit() {
        let ray = Ray { origin: DVec3::ZERO, direction: DVec3::Z };
        assert_eq!(Bvh::new(&Mesh::default()).closest_hit(&ray, 0.0, f64::INFINITY), None);
        // A thousand copies of one point: splitting must come to an end.
        let point = Mesh { vertices: vec![Vec3::Z; 3], faces: vec![[0, 1, 2]; 1000], ..Mesh::default() };
        assert_eq!(Bvh::new(&point).closest_hit(&ray, 0.0, f64::INFINITY), None);
        let sphere = Bvh::new(&shapes::icosphere(1, 1.0));
        for direction in [DVec3::ZERO, DVec3::NAN] {
            assert_eq!(sphere.closest_hit(&Ray { origin: DVec3::ZERO, direction }, 0.0, f64::INFINITY), None);
        }
    }
}
