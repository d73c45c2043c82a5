//! How far cameras are from the true ones.

use dvr_core::{Camera, Similarity};
use glam::{DMat3, DVec3};

/// Errors of cameras after a similarity, which photographs do not determine, is fitted to where cameras stand.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraErrors {
    /// For each camera the angle of the rotation between both, in degrees.
    pub rotation_degrees: Vec<f64>,
    /// For each camera how far both stand apart, as a share of the true camera's distance from the point that all true
    /// cameras look at.
    pub center_share: Vec<f64>,
    /// For each camera the error of its focal length as a share.
    pub focal_share: Vec<f64>,
}

impl CameraErrors {
    /// Compares cameras at the same places of two lists. `None` where they do not determine a similarity: fewer than three,
    /// or all on a line.
    pub fn between(found: &[Camera], truth: &[Camera]) -> Option<Self> {
        let centers = |cameras: &[Camera]| cameras.iter().map(Camera::center).collect::<Vec<DVec3>>();
        let (from, to) = (centers(found), centers(truth));
        let fit = Similarity::between(&from, &to)?;
        let turn = DMat3::from_quat(fit.rotation);
        let target = looked_at(truth);
        let pairs = || found.iter().zip(truth);
        Some(Self {
            rotation_degrees: pairs()
                .map(|(a, b)| angle(a.rotation * turn.transpose() * b.rotation.transpose()))
                .collect(),
            center_share: pairs()
                .map(|(a, b)| {
                    let (found, true_center) = (fit.transform_point(a.center()), b.center());
                    (found - true_center).length() / (true_center - target).length()
                })
                .collect(),
            focal_share: pairs().map(|(a, b)| a.intrinsics.x_axis.x / b.intrinsics.x_axis.x - 1.0).collect(),
        })
    }
}

/// The point that is nearest to the axes of all cameras.
fn looked_at(cameras: &[Camera]) -> DVec3 {
    let (mut left, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let d = camera.forward();
        // Takes a vector to its part across the axis.
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        left += across;
        right += across * camera.center();
    }
    left.inverse() * right
}

/// The angle of a rotation in degrees, exact for small ones too.
fn angle(rotation: DMat3) -> f64 {
    let sine = DVec3::new(
        rotation.y_axis.z - rotation.z_axis.y,
        rotation.z_axis.x - rotation.x_axis.z,
        rotation.x_axis.y - rotation.y_axis.x,
    );
    let trace = rotation.x_axis.x + rotation.y_axis.y + rotation.z_axis.z;
    sine.length().atan2(trace - 1.0).to_degrees()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    fn cameras() -> Vec<Camera> {
        let eyes = [
            DVec3::new(4.0, 1.0, 0.0),
            DVec3::new(0.0, 2.0, 4.0),
            DVec3::new(-4.0, 0.5, 1.0),
            DVec3::new(1.0, 3.0, -3.0),
        ];
        eyes.iter().map(|eye| Camera::look_at(64, 48, 60.0, *eye, DVec3::new(0.1, 0.2, 0.0), DVec3::Y)).collect()
    }

    #[test]
    fn a_similarity_is_no_error() {
        let truth = cameras();
        let other = Similarity {
            scale: 3.0,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0),
            translation: DVec3::new(5.0, 6.0, 7.0),
        };
        let found: Vec<Camera> = truth.iter().map(|camera| camera.into_object_space(&other)).collect();
        let errors = CameraErrors::between(&found, &truth).unwrap();
        assert!(
            errors.rotation_degrees.iter().chain(&errors.center_share).all(|error| error.abs() < 1e-9),
            "{errors:?}"
        );
    }

    #[test]
    fn a_turned_camera_has_the_angle_that_it_was_turned_by() {
        let truth = cameras();
        let mut found = truth.clone();
        let turn = DMat3::from_axis_angle(DVec3::X, 0.5f64.to_radians());
        // About itself: it stays where it is.
        found[2].rotation = turn * truth[2].rotation;
        found[2].translation = -(found[2].rotation * truth[2].center());
        let errors = CameraErrors::between(&found, &truth).unwrap();
        assert!(
            (errors.rotation_degrees[2] - 0.5).abs() < 1e-9 && errors.rotation_degrees[0].abs() < 1e-9,
            "{errors:?}"
        );
        assert!(CameraErrors::between(&found[..2], &truth[..2]).is_none());
    }
}
