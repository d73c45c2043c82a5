//! The similarity between two sets of corresponding points.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Vector3};

use crate::camera::{Camera, Similarity};

impl Similarity {
    /// The similarity that takes each point of `from` as near as possible to the one at the same place in `to`, in the
    /// sense of least squares (Umeyama 1991, equations 40 to 43).
    ///
    /// `None` where the points do not determine one: the lists differ in length, a coordinate is not finite, or the
    /// points lie on a line.
    pub fn between(from: &[DVec3], to: &[DVec3]) -> Option<Self> {
        if from.len() != to.len() || from.len() < 3 || !from.iter().chain(to).all(|point| point.is_finite()) {
            return None;
        }
        let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / points.len() as f64;
        let (from_mean, to_mean) = (mean(from), mean(to));
        let mut covariance = Matrix3::<f64>::zeros();
        let mut variance = 0.0;
        for (a, b) in from.iter().zip(to) {
            let (a, b) = (*a - from_mean, *b - to_mean);
            covariance += Vector3::from(b.to_array()) * Vector3::from(a.to_array()).transpose();
            variance += a.length_squared();
        }
        let svd = covariance.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let singular = svd.singular_values;
        // Two directions must differ for a rotation to be determined.
        if variance <= 0.0 || singular[1] <= 1e-12 * singular[0] {
            return None;
        }
        let mut signs = Vector3::new(1.0, 1.0, 1.0);
        if u.determinant() * v_t.determinant() < 0.0 {
            signs[2] = -1.0;
        }
        let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
        let scale = singular.dot(&signs) / variance;
        let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(rotation.as_slice())).normalize();
        (scale > 0.0).then(|| Self { scale, rotation, translation: to_mean - scale * (rotation * from_mean) })
    }
}

impl Similarity {
    /// The similarity that takes cameras of one space as near as possible to the same cameras in another: where they
    /// stand, and points that they look at, as far away as the origin. What photographs do not determine of where their
    /// cameras are.
    ///
    /// `None` where the cameras do not determine one.
    pub fn between_cameras<'a>(
        from: impl IntoIterator<Item = &'a Camera>,
        to: impl IntoIterator<Item = &'a Camera>,
    ) -> Option<Self> {
        let anchors = |camera: &Camera| {
            let center = camera.center();
            [center, center + center.length() * camera.forward()]
        };
        let from: Vec<DVec3> = from.into_iter().flat_map(anchors).collect();
        let to: Vec<DVec3> = to.into_iter().flat_map(anchors).collect();
        Self::between(&from, &to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<DVec3> {
        (0..12).map(f64::from).map(|i| DVec3::new(i.sin(), (2.0 * i).cos(), 0.3 * i)).collect()
    }

    #[test]
    fn the_similarity_that_moved_the_points_is_found() {
        let moved = Similarity {
            scale: 2.5,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 2.0, -0.4, 1.1),
            translation: DVec3::new(3.0, -1.0, 0.2),
        };
        let from = points();
        let to: Vec<DVec3> = from.iter().map(|&point| moved.transform_point(point)).collect();
        let found = Similarity::between(&from, &to).unwrap();
        assert!((found.scale - 2.5).abs() < 1e-12 && found.rotation.angle_between(moved.rotation) < 1e-7);
        assert!((found.translation - moved.translation).length() < 1e-12);
        // Flat points determine it as well, a mirror image does not confuse it.
        let flat: Vec<DVec3> = from.iter().map(|p| DVec3::new(p.x, p.y, 0.0)).collect();
        let mirrored: Vec<DVec3> = flat.iter().map(|p| DVec3::new(p.x, -p.y, 0.0)).collect();
        let found = Similarity::between(&flat, &mirrored).unwrap();
        assert!(flat.iter().zip(&mirrored).all(|(a, b)| (found.transform_point(*a) - *b).length() < 1e-9));
    }

    #[test]
    fn cameras_in_another_space_lead_back_to_it() {
        let eyes = [DVec3::new(2.0, 0.3, -0.4), DVec3::new(-1.0, 1.5, 0.9), DVec3::new(0.1, -0.7, 2.0)];
        let cameras = eyes.map(|eye| Camera::look_at(40, 30, 35.0, eye, DVec3::ZERO, DVec3::Y));
        // Without a shift: what cameras look at is measured from the origin.
        let space = Similarity { scale: 1.3, rotation: DQuat::from_rotation_x(0.2), translation: DVec3::ZERO };
        let moved = cameras.clone().map(|camera| camera.into_world(&space));
        let found = Similarity::between_cameras(&cameras, &moved).unwrap();
        assert!((found.scale - 1.3).abs() < 1e-9 && found.translation.length() < 1e-9, "{found:?}");
    }

    #[test]
    fn points_that_tell_nothing_are_refused() {
        let line: Vec<DVec3> = (0..5).map(|i| DVec3::X * f64::from(i)).collect();
        assert!(Similarity::between(&line, &line).is_none());
        assert!(Similarity::between(&points(), &points()[1..]).is_none());
        assert!(Similarity::between(&[DVec3::NAN; 4], &[DVec3::ZERO; 4]).is_none());
    }
}
