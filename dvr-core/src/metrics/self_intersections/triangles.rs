//! Whether two triangles have a point in common, by signs of determinants alone (after Guigue and Devillers, Fast and
//! Robust Triangle-Triangle Overlap Test Using Orientation Predicates, Journal of Graphics Tools 8(1), 2003).

use glam::{DVec2, DVec3};

/// Share of a determinant's terms below which rounding may have turned its sign (Shewchuk, Adaptive Precision
/// Floating-Point Arithmetic, 1997, section 4.4: `(7 + 56 e) e`, `e` half of this machine epsilon). Corners are single
/// precision, so what is so small is nothing that a mesh can say.
const DOUBT: f64 = 8.0 * (f64::EPSILON / 2.0);

/// Whether two closed triangles with area meet: where one goes through the other, where they touch, and where they lie on
/// each other in one plane.
pub(super) fn triangles_meet(first: [DVec3; 3], second: [DVec3; 3]) -> bool {
    let over = |[a, b, c]: [DVec3; 3], others: [DVec3; 3]| others.map(|point| side(a, b, c, point));
    let is_apart = |sides: [i8; 3]| sides == [1; 3] || sides == [-1; 3];
    let (of_second, of_first) = (over(first, second), over(second, first));
    if is_apart(of_second) || is_apart(of_first) {
        return false;
    }
    if of_second == [0; 3] || of_first == [0; 3] {
        return meet_in_plane(first, second);
    }
    pierces(first, of_first, second) || pierces(second, of_second, first)
}

/// Whether an edge of a triangle, whose corners lie on these sides of another's plane, meets that.
fn pierces(edges: [DVec3; 3], sides: [i8; 3], [a, b, c]: [DVec3; 3]) -> bool {
    [(0, 1), (1, 2), (2, 0)].into_iter().any(|(i, j)| {
        // Of an edge in the plane, the two beside it have the ends, and the other triangle's edges what is between.
        if sides[i] * sides[j] > 0 || (sides[i] == 0 && sides[j] == 0) {
            return false;
        }
        let (p, q) = (edges[i], edges[j]);
        let turns = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
        turns.iter().all(|&turn| turn >= 0) || turns.iter().all(|&turn| turn <= 0)
    })
}

/// The side of the plane through three points on which a fourth lies: 1, -1, or 0 on it.
fn side(a: DVec3, b: DVec3, c: DVec3, point: DVec3) -> i8 {
    let (u, v, w) = (a - point, b - point, c - point);
    let terms = [(u.x, v.y * w.z, v.z * w.y), (u.y, v.z * w.x, v.x * w.z), (u.z, v.x * w.y, v.y * w.x)];
    let determinant: f64 = terms.iter().map(|(factor, plus, minus)| factor * (plus - minus)).sum();
    let all: f64 = terms.iter().map(|(factor, plus, minus)| factor.abs() * (plus.abs() + minus.abs())).sum();
    sign(determinant, all)
}

fn sign(determinant: f64, terms: f64) -> i8 {
    match () {
        () if determinant > DOUBT * terms => 1,
        () if determinant < -DOUBT * terms => -1,
        () => 0,
    }
}

/// The same of triangles in one plane.
fn meet_in_plane(first: [DVec3; 3], second: [DVec3; 3]) -> bool {
    let [a, b, c] = first;
    let axis = (b - a).cross(c - a).abs().max_position();
    // Seen along the axis that the plane faces most; which way round does not matter.
    let flat = |p: DVec3| DVec2::new(p[(axis + 1) % 3], p[(axis + 2) % 3]);
    let (first, second) = (first.map(flat), second.map(flat));
    let edges = |[a, b, c]: [DVec2; 3]| [(a, b), (b, c), (c, a)];
    edges(first).iter().any(|&one| edges(second).iter().any(|&other| segments_meet(one, other)))
        || contains(first, second[0])
        || contains(second, first[0])
}

/// The side of a line on which a point lies.
fn side_of_line(a: DVec2, b: DVec2, point: DVec2) -> i8 {
    let (u, v) = (a - point, b - point);
    sign(u.x * v.y - u.y * v.x, (u.x * v.y).abs() + (u.y * v.x).abs())
}

fn segments_meet((a, b): (DVec2, DVec2), (c, d): (DVec2, DVec2)) -> bool {
    // On one line, boxes tell; elsewhere they are apart only where the segments are.
    let overlap = a.min(b).cmple(c.max(d)).all() && c.min(d).cmple(a.max(b)).all();
    overlap && side_of_line(a, b, c) * side_of_line(a, b, d) <= 0 && side_of_line(c, d, a) * side_of_line(c, d, b) <= 0
}

fn contains([a, b, c]: [DVec2; 3], point: DVec2) -> bool {
    let turns = [side_of_line(a, b, point), side_of_line(b, c, point), side_of_line(c, a, point)];
    turns.iter().all(|&turn| turn >= 0) || turns.iter().all(|&turn| turn <= 0)
}
