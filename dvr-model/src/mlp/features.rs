//! What a point gives to the network: its coordinates and their positional encoding, one row per feature.

use std::f32::consts::PI;

use glam::Vec3;

/// Coordinates, and sines and cosines of each of them in each octave.
pub(super) fn feature_count(octaves: usize) -> usize {
    3 + 6 * octaves
}

/// Features of at most `width` points: `rows` is `[feature_count][width]`; lanes without a point are zero.
pub(super) fn write_features(points: &[Vec3], octaves: usize, width: usize, rows: &mut [f32]) {
    rows.fill(0.0);
    for (lane, point) in points.iter().enumerate() {
        for axis in 0..3 {
            rows[axis * width + lane] = point[axis];
            for (k, (sin, cos)) in octaves_of(point[axis]).take(octaves).enumerate() {
                rows[(3 + 6 * k + axis) * width + lane] = sin;
                rows[(6 + 6 * k + axis) * width + lane] = cos;
            }
        }
    }
}

/// The derivative of [`write_features`] along an axis.
pub(super) fn write_tangents(points: &[Vec3], axis: usize, octaves: usize, width: usize, rows: &mut [f32]) {
    rows.fill(0.0);
    for (lane, point) in points.iter().enumerate() {
        rows[axis * width + lane] = 1.0;
        for (k, (sin, cos)) in octaves_of(point[axis]).take(octaves).enumerate() {
            let frequency = PI * (1u64 << k) as f32;
            rows[(3 + 6 * k + axis) * width + lane] = frequency * cos;
            rows[(6 + 6 * k + axis) * width + lane] = -frequency * sin;
        }
    }
}

/// `sin` and `cos` of `2^k pi x` for `k = 0, 1, ...`, each from the one before by doubling the angle.
fn octaves_of(x: f32) -> impl Iterator<Item = (f32, f32)> {
    std::iter::successors(Some((PI * x).sin_cos()), |&(sin, cos)| Some((2.0 * sin * cos, 1.0 - 2.0 * sin * sin)))
}
