//! Errors of cameras.

use std::f64::consts::TAU;

use dvr_core::Camera;
use glam::{DMat3, DVec3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// A uniformly random direction.
fn direction(rng: &mut ChaCha8Rng) -> DVec3 {
    let z: f64 = rng.random_range(-1.0..1.0);
    let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    DVec3::new(radius * cos, radius * sin, z)
}

/// Rotates a camera about its centre by this angle about a random axis.
pub(super) fn turn(camera: &mut Camera, degrees: f64, rng: &mut ChaCha8Rng) {
    turn_about(camera, DMat3::from_axis_angle(direction(rng), degrees.to_radians()));
}

/// Moves a camera by a share of its distance from the origin, in a random direction.
pub(super) fn shift(camera: &mut Camera, share: f64, rng: &mut ChaCha8Rng) {
    let center = camera.center();
    camera.translation = -(camera.rotation * (center + share * center.length() * direction(rng)));
}

/// Multiplies the focal length.
pub(super) fn zoom(camera: &mut Camera, factor: f64) {
    camera.intrinsics.x_axis *= factor;
    camera.intrinsics.y_axis *= factor;
    // The skew and the principal point stay.
    camera.intrinsics.y_axis.x /= factor;
}

/// Rotates a camera so that the centre of the frame moves by this many frames, in a random direction.
pub(super) fn look_aside(camera: &mut Camera, frames: f64, rng: &mut ChaCha8Rng) {
    let pixels = frames * f64::from(camera.width.min(camera.height));
    let angle = (pixels / camera.intrinsics.x_axis.x).atan();
    let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
    turn_about(camera, DMat3::from_axis_angle(DVec3::new(cos, sin, 0.0), angle));
}

/// Rotates a camera about its centre.
fn turn_about(camera: &mut Camera, turn: DMat3) {
    let center = camera.center();
    camera.rotation = turn * camera.rotation;
    camera.translation = -(camera.rotation * center);
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn camera() -> Camera {
        Camera::look_at(64, 64, 56.0, DVec3::new(0.4, 0.7, 1.2), DVec3::ZERO, DVec3::Y)
    }

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(5)
    }

    #[test]
    fn a_rotated_camera_is_off_by_the_angle_and_keeps_its_centre() {
        for degrees in [0.1, 0.5, 5.0] {
            let (right, mut turned) = (camera(), camera());
            turn(&mut turned, degrees, &mut rng());
            let relative = turned.rotation * right.rotation.transpose();
            let trace = relative.x_axis.x + relative.y_axis.y + relative.z_axis.z;
            assert!(((0.5 * (trace - 1.0)).acos().to_degrees() - degrees).abs() < 1e-6);
            assert!((turned.center() - right.center()).length() < 1e-12);
        }
    }

    #[test]
    fn a_shifted_camera_is_off_by_the_share() {
        let (right, mut shifted) = (camera(), camera());
        shift(&mut shifted, 0.02, &mut rng());
        assert!(((shifted.center() - right.center()).length() / right.center().length() - 0.02).abs() < 1e-12);
        assert_eq!(shifted.rotation, right.rotation);
    }

    #[test]
    fn a_zoomed_camera_sees_everything_larger_around_its_middle() {
        let mut zoomed = camera();
        zoom(&mut zoomed, 1.1);
        let point = DVec3::new(0.1, 0.2, 0.0);
        let from_middle = |camera: &Camera| camera.project(point).0 - 32.0;
        assert!((from_middle(&zoomed) - 1.1 * from_middle(&camera())).length() < 1e-9);
    }

    #[test]
    fn a_camera_that_looks_aside_has_the_object_off_centre() {
        let mut aside = camera();
        look_aside(&mut aside, 0.5, &mut rng());
        assert!(((aside.project(DVec3::ZERO).0 - 32.0).length() - 32.0).abs() < 1e-6, "on the border");
    }
}
