//! Half of space: what lies before a plane.

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::camera::Similarity;

/// The points before a plane, `normal . p > offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HalfSpace {
    /// Unit normal of the plane, towards the half.
    pub normal: DVec3,
    /// Distance of the plane from the origin, along the normal.
    pub offset: f64,
}

impl HalfSpace {
    /// Distance to the plane, positive before it.
    pub fn distance(&self, point: Vec3) -> f64 {
        self.normal.dot(point.as_dvec3()) - self.offset
    }

    /// The same half where a similarity takes it.
    pub fn transformed(&self, similarity: &Similarity) -> Self {
        let normal = similarity.rotation * self.normal;
        Self { normal, offset: similarity.scale * self.offset + normal.dot(similarity.translation) }
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn points_and_planes_move_alike() {
        let half = HalfSpace { normal: DVec3::new(0.6, 0.0, 0.8), offset: 0.3 };
        let similarity =
            Similarity { scale: 2.5, rotation: DQuat::from_rotation_x(0.7), translation: DVec3::new(3.0, -1.0, 2.0) };
        let (moved, point) = (half.transformed(&similarity), Vec3::new(0.2, 0.5, -0.1));
        let expected = 2.5 * half.distance(point);
        assert!((moved.distance(similarity.transform_point_f32(point)) - expected).abs() < 1e-6);
        assert!((moved.transformed(&similarity.inverse()).offset - half.offset).abs() < 1e-12);
    }
}
