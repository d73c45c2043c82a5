//! Cutting polygons into triangles.

use glam::{Vec2, Vec3};

use super::problem::Problem;
use crate::files::limits::POLYGON_CORNERS;

/// Triangles that cover a simple polygon, as indices into its corners, with the polygon's winding.
///
/// Ear clipping (Meisters 1975) in the plane of the Newell normal: right for concave outlines, and never fails; a
/// polygon that crosses itself or has no area is cut into a fan. Fewer than three corners give nothing.
///
/// # Errors
/// [`Problem::TooLarge`] where a polygon that is not convex has more than [`POLYGON_CORNERS`].
pub(super) fn triangulate(corners: &[Vec3]) -> Result<Vec<[usize; 3]>, Problem> {
    let fan = || (1..corners.len().saturating_sub(1)).map(|i| [0, i, i + 1]).collect();
    if corners.len() <= 3 {
        return Ok(fan());
    }
    let mut ring = Ring::new(flatten(corners));
    if (0..corners.len()).all(|i| ring.turn(i) >= 0.0) {
        return Ok(fan());
    }
    if corners.len() > POLYGON_CORNERS {
        let (value, limit) = (corners.len() as u64, POLYGON_CORNERS as u64);
        return Err(Problem::TooLarge { what: "the number of a face's corners", value, limit });
    }
    let mut triangles = Vec::with_capacity(corners.len() - 2);
    while triangles.len() + 3 < corners.len() {
        let Some(ear) = ring.first_ear() else { return Ok(fan()) };
        triangles.push(ring.neighbours(ear));
        ring.cut(ear);
    }
    triangles.push(ring.neighbours(ring.next[ring.first]));
    Ok(triangles)
}

/// The corners in the plane of the polygon, counter-clockwise.
fn flatten(corners: &[Vec3]) -> Vec<Vec2> {
    let next = corners.iter().cycle().skip(1);
    // Relative to the first corner: far from the origin the products would lose the polygon's size.
    let normal: Vec3 = corners.iter().zip(next).map(|(&a, &b)| (a - corners[0]).cross(b - corners[0])).sum();
    let normal = normal.normalize_or(Vec3::Z);
    let (x, y) = normal.any_orthonormal_pair();
    let (x, y) = if x.cross(y).dot(normal) > 0.0 { (x, y) } else { (y, x) };
    corners.iter().map(|&c| Vec2::new((c - corners[0]).dot(x), (c - corners[0]).dot(y))).collect()
}

/// The corners that are left of a polygon, in their order.
///
/// A corner whose triangle holds another stays no ear until one of the two is gone: the search goes on where it found
/// that other corner, so that all searches together take time by the square of the corners.
struct Ring {
    outline: Vec<Vec2>,
    next: Vec<usize>,
    previous: Vec<usize>,
    is_left: Vec<bool>,
    /// The corner that comes first.
    first: usize,
    /// For each corner the first that its triangle may hold: those before are gone, or outside of it.
    candidate: Vec<usize>,
}

impl Ring {
    fn new(outline: Vec<Vec2>) -> Self {
        let count = outline.len();
        Self {
            next: (0..count).map(|i| (i + 1) % count).collect(),
            previous: (0..count).map(|i| (i + count - 1) % count).collect(),
            is_left: vec![true; count],
            first: 0,
            candidate: vec![0; count],
            outline,
        }
    }

    fn neighbours(&self, corner: usize) -> [usize; 3] {
        [self.previous[corner], corner, self.next[corner]]
    }

    /// Twice the signed area of the triangle at a corner; negative where the outline turns inwards.
    fn turn(&self, corner: usize) -> f32 {
        let [a, b, c] = self.neighbours(corner).map(|k| self.outline[k]);
        (b - a).perp_dot(c - b)
    }

    /// The first corner whose triangle lies inside the polygon and holds none of its other corners.
    fn first_ear(&mut self) -> Option<usize> {
        let mut corner = self.first;
        loop {
            if self.is_ear(corner) {
                return Some(corner);
            }
            corner = self.next[corner];
            if corner == self.first {
                return None;
            }
        }
    }

    fn is_ear(&mut self, corner: usize) -> bool {
        if self.turn(corner) <= 0.0 {
            return false;
        }
        let [a, b, c] = self.neighbours(corner).map(|k| self.outline[k]);
        let holds = |p: Vec2| {
            (b - a).perp_dot(p - a) >= 0.0 && (c - b).perp_dot(p - b) >= 0.0 && (a - c).perp_dot(p - c) >= 0.0
        };
        let start = self.candidate[corner];
        let held = (start..self.outline.len()).find(|&k| {
            let p = self.outline[k];
            self.is_left[k] && p != a && p != b && p != c && holds(p)
        });
        self.candidate[corner] = held.unwrap_or(self.outline.len());
        held.is_none()
    }

    /// Cuts off a corner; the triangles of its neighbours become others.
    fn cut(&mut self, corner: usize) {
        let [before, _, after] = self.neighbours(corner);
        self.next[before] = after;
        self.previous[after] = before;
        self.is_left[corner] = false;
        if corner == self.first {
            self.first = after;
        }
        self.candidate[before] = 0;
        self.candidate[after] = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[Vec3], triangles: &[[usize; 3]]) -> Vec3 {
        triangles
            .iter()
            .map(|t| t.map(|i| corners[i]))
            .map(|[a, b, c]| 0.5 * (b - a).cross(c - a))
            .inspect(|n| assert!(n.z >= 0.0, "a triangle is wound the other way"))
            .sum()
    }

    #[test]
    fn an_arrow_head_is_not_covered_from_outside() {
        // Concave at the second corner: a fan from the first would cover ground outside the outline.
        let corners = [[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 5.0));
        for shift in 0..4 {
            let mut turned = corners;
            turned.rotate_left(shift);
            let triangles = triangulate(&turned).unwrap();
            assert_eq!(triangles.len(), 2);
            assert!((area(&turned, &triangles).z - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_star_keeps_its_area() {
        let corners: Vec<Vec3> = (0..10)
            .map(|i| {
                let (angle, radius) = (i as f32 * std::f32::consts::PI / 5.0, [1.0, 0.4][i % 2]);
                Vec3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
            })
            .collect();
        let triangles = triangulate(&corners).unwrap();
        let expected = 5.0 * 0.4 * (std::f32::consts::PI / 5.0).sin();
        assert_eq!(triangles.len(), 8);
        assert!((area(&corners, &triangles).z - expected).abs() < 1e-5);
    }

    #[test]
    fn what_has_no_area_still_gives_triangles() {
        assert_eq!(triangulate(&[Vec3::ZERO; 5]).unwrap().len(), 3);
        assert_eq!(triangulate(&[Vec3::ZERO; 2]).unwrap().len(), 0);
        assert_eq!(triangulate(&[]).unwrap().len(), 0);
    }

    /// Ear clipping as its definition has it: every corner is asked anew.
    fn by_definition(corners: &[Vec3]) -> Vec<[usize; 3]> {
        let outline = flatten(corners);
        let mut left: Vec<usize> = (0..corners.len()).collect();
        let mut triangles = Vec::new();
        while left.len() > 3 {
            let at = |i: usize| [left[(i + left.len() - 1) % left.len()], left[i], left[(i + 1) % left.len()]];
            let ear = (0..left.len()).find(|&i| {
                let [a, b, c] = at(i).map(|k| outline[k]);
                let inside = |[a, b]: [Vec2; 2], p: Vec2| (b - a).perp_dot(p - a) >= 0.0;
                let mut others = left.iter().map(|&k| outline[k]).filter(|&p| p != a && p != b && p != c);
                (b - a).perp_dot(c - b) > 0.0 && !others.any(|p| [[a, b], [b, c], [c, a]].iter().all(|&e| inside(e, p)))
            });
            let Some(ear) = ear else { return (1..corners.len() - 1).map(|i| [0, i, i + 1]).collect() };
            triangles.push(at(ear));
            left.remove(ear);
        }
        triangles.push([left[0], left[1], left[2]]);
        triangles
    }

    #[test]
    fn ears_are_cut_in_the_order_of_the_definition() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32
        };
        for round in 0..200 {
            let count = 4 + round % 40;
            // A star with spikes of all lengths, at times with corners out of order: then it crosses itself.
            let corner = |i: usize, r: f32| {
                let angle = i as f32 / count as f32 * std::f32::consts::TAU;
                Vec3::new(r * angle.cos(), r * angle.sin(), 0.0)
            };
            let mut corners: Vec<Vec3> = (0..count).map(|i| corner(i, 0.1 + random())).collect();
            if round % 5 == 0 {
                corners.swap(0, count / 2);
            }
            let turns = (0..count).map(|i| Ring::new(flatten(&corners)).turn(i));
            if turns.fold(0.0, f32::min) < 0.0 {
                assert_eq!(triangulate(&corners).unwrap(), by_definition(&corners), "round {round}");
            }
        }
    }

    #[test]
    fn a_polygon_of_too_many_corners_is_refused_unless_it_is_convex() {
        let comb = |count: usize| -> Vec<Vec3> {
            (0..count).map(|i| Vec3::new(i as f32, if i % 2 == 0 { 0.0 } else { 1.0 }, 0.0)).collect()
        };
        let limit = POLYGON_CORNERS as u64;
        let refused = triangulate(&comb(POLYGON_CORNERS + 1));
        assert!(matches!(refused, Err(Problem::TooLarge { value, limit: l, .. }) if value == limit + 1 && l == limit));
        assert_eq!(triangulate(&comb(POLYGON_CORNERS)).unwrap().len(), POLYGON_CORNERS - 2);
        let line: Vec<Vec3> = (0..100_000).map(|i| Vec3::X * i as f32).collect();
        assert_eq!(triangulate(&line).unwrap().len(), 99_998);
    }
}
