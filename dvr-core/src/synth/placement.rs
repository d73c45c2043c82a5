//! Where the cameras of a synthetic dataset stand.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::config::{CameraPlacement, SynthConfig};
use crate::camera::Camera;

/// The cameras of a dataset, in object space: all look at the origin.
pub fn place_cameras(config: &SynthConfig) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    let start = rng.random_range(0.0..TAU);
    let count = config.views as f64;
    // Mean distance of neighbours on the unit sphere.
    let spacing = match config.placement {
        CameraPlacement::Sphere => (4.0 * PI / count).sqrt(),
        CameraPlacement::UpperHemisphere => (2.0 * PI / count).sqrt(),
        CameraPlacement::Ring { .. } => TAU / count,
        CameraPlacement::Arc { angle, .. } => angle.to_radians() / count,
        CameraPlacement::Cap { half_angle } => (TAU * (1.0 - half_angle.to_radians().cos()) / count).sqrt(),
    };
    let focal = 0.5 * config.focal * f64::from(config.width.min(config.height));
    (0..config.views)
        .map(|view| {
            let regular = direction(config.placement, view as f64, count, start);
            let shift = DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
            let shift = config.jitter * spacing * shift.clamp_length_max(1.0).reject_from(regular);
            let eye = config.distance * (regular + shift).normalize();
            Camera::look_at(config.width, config.height, focal, eye, DVec3::ZERO, DVec3::Y)
        })
        .collect()
}

/// The unit vector to the regular place of a view.
fn direction(placement: CameraPlacement, view: f64, count: f64, start: f64) -> DVec3 {
    // Turning by the golden angle spreads points evenly at any count (Vogel 1979).
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    let (height, angle) = match placement {
        CameraPlacement::Sphere => (1.0 - (2.0 * view + 1.0) / count, start + golden_angle * view),
        CameraPlacement::UpperHemisphere => (1.0 - (view + 0.5) / count, start + golden_angle * view),
        CameraPlacement::Ring { elevation } => (elevation.to_radians().sin(), start + TAU * view / count),
        // As the cap, its middle is to the side of +z.
        CameraPlacement::Arc { elevation, angle } => {
            (elevation.to_radians().sin(), 0.5 * PI + angle.to_radians() * ((view + 0.5) / count - 0.5))
        }
        CameraPlacement::Cap { half_angle } => {
            let share = 0.5 * (1.0 - half_angle.to_radians().cos());
            (1.0 - share * (2.0 * view + 1.0) / count, start + golden_angle * view)
        }
    };
    let radius = (1.0 - height * height).max(0.0).sqrt();
    let around_y = DVec3::new(radius * angle.cos(), height, radius * angle.sin());
    match placement {
        CameraPlacement::Cap { .. } => DQuat::from_rotation_arc(DVec3::Y, cap_axis()) * around_y,
        _ => around_y,
    }
}

/// The middle of a cap of cameras: to the side, raised by 30 degrees.
fn cap_axis() -> DVec3 {
    DVec3::new(0.0, 0.5, 0.75f64.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eyes(config: &SynthConfig) -> Vec<DVec3> {
        place_cameras(config).iter().map(Camera::center).collect()
    }

    #[test]
    fn cameras_surround_the_object_and_look_at_it() {
        let config = SynthConfig { views: 100, ..SynthConfig::default() };
        for camera in place_cameras(&config) {
            assert!((camera.center().length() - 1.5).abs() < 1e-12);
            let (pixel, z) = camera.project(DVec3::ZERO);
            assert!((pixel - 32.0).length() < 1e-9 && (z - 1.5).abs() < 1e-12);
        }
        let mean = eyes(&config).iter().sum::<DVec3>() / 100.0;
        assert!(mean.length() < 0.15, "{mean}");
        let nearest = |a: &DVec3| eyes(&config).iter().map(|b| a.distance(*b)).filter(|d| *d > 0.0).fold(9.0, f64::min);
        assert!(eyes(&config).iter().all(|e| nearest(e) > 0.15), "two cameras stand in one place");
    }

    #[test]
    fn the_hemisphere_is_above_and_the_ring_at_its_height() {
        let still = SynthConfig { jitter: 0.0, ..SynthConfig::default() };
        let above = SynthConfig { placement: CameraPlacement::UpperHemisphere, ..still.clone() };
        assert!(eyes(&above).iter().all(|eye| eye.y > 0.0));
        let ring = SynthConfig { placement: CameraPlacement::Ring { elevation: 30.0 }, ..still };
        assert!(eyes(&ring).iter().all(|eye| (eye.y - 0.75).abs() < 1e-12));
    }

    #[test]
    fn a_cap_of_cameras_stays_within_its_angle_and_fills_it() {
        for half_angle in [30.0f64, 90.0, 180.0] {
            let placement = CameraPlacement::Cap { half_angle };
            let config = SynthConfig { placement, jitter: 0.0, views: 200, ..SynthConfig::default() };
            let angle = |eye: &DVec3| eye.normalize().dot(cap_axis()).clamp(-1.0, 1.0).acos().to_degrees();
            let widest = eyes(&config).iter().map(angle).fold(0.0, f64::max);
            assert!(widest <= half_angle && widest > 0.9 * half_angle, "{widest} of {half_angle}");
        }
    }

    #[test]
    fn an_arc_of_cameras_is_a_part_of_a_ring() {
        for angle in [30.0f64, 120.0, 360.0] {
            let placement = CameraPlacement::Arc { elevation: 30.0, angle };
            let config = SynthConfig { placement, jitter: 0.0, ..SynthConfig::default() };
            assert!(eyes(&config).iter().all(|eye| (eye.y - 0.75).abs() < 1e-12), "at one height");
            // From the middle, to the right and to the left.
            let azimuths: Vec<f64> = eyes(&config).iter().map(|eye| eye.x.atan2(eye.z).to_degrees()).collect();
            let (least, most) = azimuths.iter().fold((0.0, 0.0), |(a, b), x| (x.min(a), x.max(b)));
            assert!(
                ((most - least) - angle * 23.0 / 24.0).abs() < 1e-9 && (most + least).abs() < 1e-9,
                "{least} {most}"
            );
        }
    }

    #[test]
    fn another_seed_gives_other_cameras() {
        let config = SynthConfig::default();
        assert_eq!(eyes(&config), eyes(&config));
        assert_ne!(eyes(&config), eyes(&SynthConfig { seed: 1, ..config.clone() }));
    }

    #[test]
    fn an_image_that_is_not_square_has_square_pixels() {
        let config = SynthConfig { width: 160, height: 90, ..SynthConfig::default() };
        let camera = &place_cameras(&config)[0];
        assert_eq!(camera.intrinsics.x_axis.x, camera.intrinsics.y_axis.y);
        assert_eq!(camera.intrinsics.y_axis.y, 0.5 * 1.75 * 90.0);
    }
}
