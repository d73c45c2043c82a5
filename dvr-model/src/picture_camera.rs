//! Cameras of the square pictures that encoders see, as numbers that a network can guess.

use dvr_core::Camera;
use glam::{DMat3, DVec2, DVec3};

/// Two rows of the rotation, the translation, and the logarithm of the focal length in widths of the picture. Rotations as two
/// rows have no jumps (Zhou et al. 2019, section 4).
pub(crate) const CAMERA_NUMBERS: usize = 10;

/// The numbers of a camera.
pub(crate) fn camera_numbers(camera: &Camera) -> [f32; CAMERA_NUMBERS] {
    let rows = [camera.rotation.row(0), camera.rotation.row(1), camera.translation];
    let mut numbers = [0.0; CAMERA_NUMBERS];
    for (number, value) in numbers.iter_mut().zip(rows.iter().flat_map(|row| row.to_array())) {
        *number = value as f32;
    }
    numbers[9] = (camera.intrinsics.x_axis.x.abs().max(1e-6) / f64::from(camera.width)).ln() as f32;
    numbers
}

/// The camera of a picture `size` pixels wide that has these numbers, or nearly: its principal point is the middle.
pub(crate) fn camera_of_numbers(numbers: &[f32], size: u32) -> Camera {
    let number = |i: usize| numbers.get(i).copied().filter(|number| number.is_finite()).map_or(0.0, f64::from);
    let row = |i: usize| DVec3::new(number(3 * i), number(3 * i + 1), number(3 * i + 2));
    let x = row(0).try_normalize().unwrap_or(DVec3::X);
    let y = (row(1) - x * row(1).dot(x)).try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
    let rotation = DMat3::from_cols(x, y, x.cross(y)).transpose();
    let width = f64::from(size);
    // Far from what any lens has, the guess is of no use, but a camera all the same.
    let focal = width * number(9).clamp(-3.0, 5.0).exp();
    let intrinsics = DMat3::from_cols(
        DVec3::new(focal, 0.0, 0.0),
        DVec3::new(0.0, focal, 0.0),
        DVec2::splat(0.5 * width).extend(1.0),
    );
    Camera { width: size, height: size, intrinsics, rotation, translation: row(2) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_is_found_again_in_its_numbers() {
        let camera = Camera::look_at(64, 64, 70.0, DVec3::new(0.8, 0.5, -1.2), DVec3::ZERO, DVec3::Y);
        let again = camera_of_numbers(&camera_numbers(&camera), 64);
        let point = DVec3::new(0.1, -0.2, 0.3);
        let apart = (camera.project(point).0 - again.project(point).0).length();
        assert!(apart < 1e-4, "{apart}");
    }

    #[test]
    fn any_numbers_make_a_camera() {
        for numbers in [[0.0; CAMERA_NUMBERS], [f32::NAN; CAMERA_NUMBERS], [1e30; CAMERA_NUMBERS]] {
            let Camera { rotation, translation, intrinsics, .. } = camera_of_numbers(&numbers, 64);
            assert!((rotation.determinant() - 1.0).abs() < 1e-9, "{numbers:?}");
            assert!(translation.is_finite() && intrinsics.is_finite(), "{numbers:?}");
        }
    }
}
