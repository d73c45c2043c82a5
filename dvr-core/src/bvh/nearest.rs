//! The point of a mesh that is nearest to a given one, exactly.

use glam::{DVec3, Vec3};

use super::node::Node;
use super::tree::{Bvh, STACK_SIZE};

/// The point of a mesh that is nearest to a given one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPoint {
    /// Index of the face that it lies on.
    pub face: u32,
    /// Where it is.
    pub position: DVec3,
    /// How far it is, in the units of the mesh.
    pub distance: f64,
}

impl Bvh {
    /// The nearest point of all triangles, their edges and corners included; faces without area count as the segments
    /// that they are. `None` for a mesh without faces and for a point that is not finite.
    ///
    /// Computed in double precision. Where several faces are equally near (at a shared edge) the one with the smallest
    /// index is given.
    pub fn nearest(&self, point: DVec3) -> Option<NearestPoint> {
        if self.faces.is_empty() || !point.is_finite() {
            return None;
        }
        // Squared distances, so that the loop takes no roots.
        let mut best = (f64::INFINITY, u32::MAX, DVec3::NAN);
        let mut stack = [(0u32, 0.0f64); STACK_SIZE];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (index, bound) = stack[height];
            if bound > best.0 {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count() > 0 {
                for i in node.first()..node.first() + node.count() {
                    let position = nearest_on_triangle(point, &self.triangles[i as usize]);
                    let (squared, face) = ((position - point).length_squared(), self.faces[i as usize]);
                    if squared < best.0 || (squared == best.0 && face < best.1) {
                        best = (squared, face, position);
                    }
                }
                continue;
            }
            let child = |i: u32| (i, squared_distance(point, &self.nodes[i as usize]));
            let (mut near, mut far) = (child(node.first()), child(node.first() + 1));
            if near.1 > far.1 {
                (near, far) = (far, near);
            }
            for next in [far, near] {
                stack[height] = next;
                height += 1;
            }
        }
        best.0.is_finite().then(|| NearestPoint { face: best.1, position: best.2, distance: best.0.sqrt() })
    }
}

/// To the nearest point of a box; 0 inside.
fn squared_distance(point: DVec3, node: &Node) -> f64 {
    (point - point.clamp(node.low().as_dvec3(), node.high().as_dvec3())).length_squared()
}

/// The nearest point of a triangle: the foot of the perpendicular where that lies inside, else on one of the edges.
pub(super) fn nearest_on_triangle(point: DVec3, corners: &[Vec3; 3]) -> DVec3 {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let normal = (b - a).cross(c - a);
    let squared = normal.length_squared();
    let is_left_of = |from: DVec3, to: DVec3| (to - from).cross(point - from).dot(normal) >= 0.0;
    if squared > 0.0 && is_left_of(a, b) && is_left_of(b, c) && is_left_of(c, a) {
        return point - normal * (normal.dot(point - a) / squared);
    }
    let on_edges = [(a, b), (b, c), (c, a)].map(|(from, to)| nearest_on_segment(point, from, to));
    let nearer = |x: DVec3, y: DVec3| if y.distance_squared(point) < x.distance_squared(point) { y } else { x };
    on_edges.into_iter().fold(on_edges[0], nearer)
}

/// The nearest point of a segment, which may be a point.
fn nearest_on_segment(point: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    let along = to - from;
    let squared = along.length_squared();
    // 0 / 0 would be NaN.
    let share = if squared > 0.0 { ((point - from).dot(along) / squared).clamp(0.0, 1.0) } else { 0.0 };
    from + share * along
}
