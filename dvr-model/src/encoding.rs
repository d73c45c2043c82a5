//! Positional encoding: sines and cosines of the coordinates in octaves (Mildenhall et al. 2020, equation 4).
//!
//! The wavelength of octave `k` is `2^(1 - k)` object units, so octave 0 spans the padded cube about once.

use std::f64::consts::PI;

use burn::tensor::Tensor;

/// `[p, sin(2^k pi p), cos(2^k pi p)]` for `k < octaves`: `[n, 3]` to `[n, 3 + 6 octaves]`.
pub(crate) fn encode(points: Tensor<2>, octaves: usize) -> Tensor<2> {
    if octaves == 0 {
        return points;
    }
    let mut features = vec![points.clone()];
    for k in 0..octaves {
        let phase = points.clone() * frequency(k);
        features.extend([phase.clone().sin(), phase.cos()]);
    }
    Tensor::cat(features, 1)
}

/// The derivative of [`encode`] along a direction per point, both `[n, 3]`.
pub(crate) fn encode_tangent(points: Tensor<2>, direction: Tensor<2>, octaves: usize) -> Tensor<2> {
    if octaves == 0 {
        return direction;
    }
    let mut features = vec![direction.clone()];
    for k in 0..octaves {
        let phase = points.clone() * frequency(k);
        let turn = direction.clone() * frequency(k);
        features.extend([phase.clone().cos() * turn.clone(), phase.sin().neg() * turn]);
    }
    Tensor::cat(features, 1)
}

/// Angular frequency of octave `k`.
fn frequency(k: usize) -> f64 {
    PI * (1u64 << k) as f64
}
