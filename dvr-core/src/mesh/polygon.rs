//! Cutting polygons into triangles.

use glam::{Vec2, Vec3};

/// Triangles that cover a simple polygon, as indices into its corners, with the polygon's winding.
///
/// Ear clipping (Meisters 1975) in the plane of the Newell normal: right for concave outlines, and never fails; a
/// polygon that crosses itself or has no area is cut into a fan. Fewer than three corners give nothing.
pub(super) fn triangulate(corners: &[Vec3]) -> Vec<[usize; 3]> {
    let fan = || (1..corners.len().saturating_sub(1)).map(|i| [0, i, i + 1]).collect();
    if corners.len() <= 3 {
        return fan();
    }
    let outline = flatten(corners);
    let mut ring: Vec<usize> = (0..corners.len()).collect();
    if (0..ring.len()).all(|i| turn(&outline, &ring, i) >= 0.0) {
        return fan();
    }
    let mut triangles = Vec::with_capacity(corners.len() - 2);
    while ring.len() > 3 {
        let Some(ear) = (0..ring.len()).find(|&i| is_ear(&outline, &ring, i)) else { return fan() };
        triangles.push(neighbours(&ring, ear));
        ring.remove(ear);
    }
    triangles.push([ring[0], ring[1], ring[2]]);
    triangles
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

fn neighbours(ring: &[usize], i: usize) -> [usize; 3] {
    [ring[(i + ring.len() - 1) % ring.len()], ring[i], ring[(i + 1) % ring.len()]]
}

/// Twice the signed area of the triangle at a corner of the ring; negative where the outline turns inwards.
fn turn(outline: &[Vec2], ring: &[usize], i: usize) -> f32 {
    let [a, b, c] = neighbours(ring, i).map(|k| outline[k]);
    (b - a).perp_dot(c - b)
}

/// Whether the triangle at a corner lies inside the polygon and holds none of its other corners.
fn is_ear(outline: &[Vec2], ring: &[usize], i: usize) -> bool {
    if turn(outline, ring, i) <= 0.0 {
        return false;
    }
    let [a, b, c] = neighbours(ring, i).map(|k| outline[k]);
    let holds =
        |p: Vec2| (b - a).perp_dot(p - a) >= 0.0 && (c - b).perp_dot(p - b) >= 0.0 && (a - c).perp_dot(p - c) >= 0.0;
    ring.iter().map(|&k| outline[k]).filter(|&p| p != a && p != b && p != c).all(|p| !holds(p))
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
            let triangles = triangulate(&turned);
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
        let triangles = triangulate(&corners);
        let expected = 5.0 * 0.4 * (std::f32::consts::PI / 5.0).sin();
        assert_eq!(triangles.len(), 8);
        assert!((area(&corners, &triangles).z - expected).abs() < 1e-5);
    }

    #[test]
    fn what_has_no_area_still_gives_triangles() {
        assert_eq!(triangulate(&[Vec3::ZERO; 5]).len(), 3);
        assert_eq!(triangulate(&[Vec3::ZERO; 2]).len(), 0);
        assert_eq!(triangulate(&[]).len(), 0);
    }
}
