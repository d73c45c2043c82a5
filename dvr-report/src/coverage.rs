//! Coverage: how much of a surface the photographs see.

use dvr_core::mesh::Mesh;

/// How much of the surface of a mesh is seen, as shares of its area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// No view sees it.
    pub unseen: f64,
    /// A single view sees it: its colour is known, its depth is not.
    pub seen_once: f64,
    /// Mean confidence.
    pub confidence: f64,
}

impl Coverage {
    /// Of a mesh with observations; `None` where it has none, or no area.
    pub fn of(mesh: &Mesh) -> Option<Self> {
        let observations = mesh.observations.as_ref()?;
        let (mut area, mut unseen, mut once, mut confidence) = (0.0, 0.0, 0.0, 0.0);
        for (face, corners) in mesh.faces.iter().enumerate() {
            let [a, b, c] = mesh.triangle(face);
            // A corner has a third of its face.
            let share = f64::from((b - a).cross(c - a).length()) / 6.0;
            for &corner in corners {
                let seen = observations[corner as usize];
                area += share;
                unseen += if seen.views == 0 { share } else { 0.0 };
                once += if seen.views == 1 { share } else { 0.0 };
                confidence += share * f64::from(seen.confidence);
            }
        }
        let coverage = Self { unseen: unseen / area, seen_once: once / area, confidence: confidence / area };
        (area > 0.0).then_some(coverage)
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::mesh::shapes;
    use dvr_core::{Camera, Visibility};
    use glam::DVec3;

    use super::*;

    #[test]
    fn of_a_ball_seen_from_one_side_more_than_half_was_never_seen() {
        let mut ball = shapes::icosphere(4, 0.4);
        assert!(Coverage::of(&ball).is_none());
        let camera = Camera::look_at(64, 64, 64.0, 2.0 * DVec3::Z, DVec3::ZERO, DVec3::Y);
        ball.observations = Some(Visibility::new(&ball).observe(&[&camera]));
        let coverage = Coverage::of(&ball).unwrap();
        assert!((0.55..0.75).contains(&coverage.unseen), "{coverage:?}");
        assert!((coverage.unseen + coverage.seen_once - 1.0).abs() < 1e-6 && coverage.confidence < 0.2);
    }
}
