//! Objects in two parts: far from each other, or very different in size.

use dvr_core::mesh::Mesh;
use dvr_core::mesh::shapes::icosphere;
use glam::Vec3;

fn ball(radius: f32, center: Vec3) -> Mesh {
    let mut mesh = icosphere(4, radius);
    mesh.vertices.iter_mut().for_each(|v| *v += center);
    mesh
}

/// Direction in which the parts lie.
const DIRECTION: Vec3 = Vec3::new(0.48, 0.6, 0.64);

/// Two equal balls with a gap of `gap` radii; together they are as long as the object may be.
pub(crate) fn far_apart(gap: f64) -> [Mesh; 2] {
    let radius = 0.84 / (gap as f32 + 4.0);
    let center = (0.5 * gap as f32 + 1.0) * radius * DIRECTION;
    [ball(radius, center), ball(radius, -center)]
}

/// A large ball, and a tiny one of this radius beside it.
pub(crate) fn tiny_beside_large(radius: f64) -> [Mesh; 2] {
    [ball(0.24, -0.14 * DIRECTION), ball(radius as f32, 0.28 * DIRECTION)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(mesh: &Mesh) -> (f32, f32) {
        let heights = || mesh.vertices.iter().map(|v| v.dot(DIRECTION.normalize()));
        (heights().fold(f32::INFINITY, f32::min), heights().fold(f32::NEG_INFINITY, f32::max))
    }

    #[test]
    fn two_balls_are_as_far_apart_as_they_say() {
        for gap in [1.0, 12.0, 24.0] {
            let [near, far] = far_apart(gap).map(|mesh| span(&mesh));
            let radius = 0.5 * (near.1 - near.0);
            assert!(((near.0 - far.1) / radius - gap as f32).abs() < 0.05, "{gap}");
            assert!((near.1 - far.0 - 0.84).abs() < 0.01, "as long together at any gap");
        }
    }

    #[test]
    fn the_tiny_ball_is_off_the_large_one() {
        let [large, tiny] = tiny_beside_large(0.1).map(|mesh| span(&mesh));
        assert!(tiny.0 > large.1, "{tiny:?} {large:?}");
    }
}
