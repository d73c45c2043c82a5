//! The slope of the field along a ray, and how its inverse is kept finite: for tensors, for one ray, and, by its
//! parameters, for kernels.

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

/// How `1/s` is kept finite where a ray grazes the surface (`s -> 0`).
///
/// Near a smooth silhouette the exact gradient grows like the inverse square root of the distance in the image: its
/// mean is finite, its variance is not. Both rules trade a little bias at grazing rays for a bounded step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum SlopeRule {
    /// Scale-free and sign-keeping: with the cosine `c = s / (|g| |w|)` between gradient and ray, `1/s` becomes
    /// `c / (c^2 + epsilon^2) / (|g| |w|)`. The gain is at most `1 / (2 epsilon)`, at `c = epsilon`, whatever the scale
    /// of `f` and the length of `w`; at `c = 0` it vanishes instead of jumping between infinities.
    ScaleFree {
        /// The cosine at which damping sets in.
        epsilon: f64,
    },
    /// The clamp of DVR's reference code: slopes with `|s| < epsilon` become `+epsilon`, which depends on the scale of `f` and
    /// flips the sign of small negative slopes. Kept so that old results can be reproduced.
    Classic {
        /// The threshold; 1e-3 in the reference code.
        epsilon: f64,
    },
}

impl Default for SlopeRule {
    /// Scale-free, damped below 3 degrees of grazing incidence.
    fn default() -> Self {
        Self::ScaleFree { epsilon: Self::GRAZING_COSINE }
    }
}

impl SlopeRule {
    /// The rule of DVR's reference code.
    pub const CLASSIC: Self = Self::Classic { epsilon: 1e-3 };

    /// The cosine at which the default's damping sets in: 3 degrees.
    pub const GRAZING_COSINE: f64 = 0.05;

    /// The `epsilon` of the scale-free rule; `None` for any other. For kernels that implement this rule alone.
    pub fn scale_free_epsilon(&self) -> Option<f64> {
        match *self {
            Self::ScaleFree { epsilon } => Some(epsilon),
            Self::Classic { .. } => None,
        }
    }

    /// The regularised `1/s`, `[n]`, from `g = grad_p f` and the ray directions `w`, both `[n, 3]`.
    pub fn inverse_slope(&self, gradient: Tensor<2>, direction: Tensor<2>) -> Tensor<1> {
        let slope = dot(gradient.clone(), direction.clone());
        match *self {
            Self::ScaleFree { epsilon } => {
                let scale = (dot(gradient.clone(), gradient) * dot(direction.clone(), direction)).sqrt();
                // A gradient of zero carries no information: its cosine is taken as 0 and the ray is silent.
                let scale = scale.clamp_min(1e-20);
                let cosine = slope / scale.clone();
                cosine.clone() / (cosine.square() + epsilon * epsilon) / scale
            }
            Self::Classic { epsilon } => {
                let small = slope.clone().abs().lower_elem(epsilon);
                slope.mask_fill(small, epsilon).recip()
            }
        }
    }

    /// The same for one ray: from its slope `s` and the lengths' product `|g| |w|`.
    pub fn inverse_slope_of(&self, slope: f32, scale: f32) -> f32 {
        match *self {
            Self::ScaleFree { epsilon } => {
                let (scale, epsilon) = (scale.max(1e-20), epsilon as f32);
                let cosine = slope / scale;
                cosine / (cosine * cosine + epsilon * epsilon) / scale
            }
            Self::Classic { epsilon } => (if slope.abs() < epsilon as f32 { epsilon as f32 } else { slope }).recip(),
        }
    }
}

/// Row-wise scalar product of two `[n, 3]` tensors, `[n]`.
pub fn dot(a: Tensor<2>, b: Tensor<2>) -> Tensor<1> {
    (a * b).sum_dim(1).squeeze_dim(1)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    #[test]
    fn one_ray_and_a_tensor_of_rays_have_the_same_inverse_slopes() {
        let device = Device::flex();
        let gradients = [[1.0f32, 0.5, -2.0], [0.0, 3.0, 0.001], [0.0, 0.0, 0.0], [1e-4, 0.0, 1e-4]];
        let directions = [[0.3f32, -0.2, 1.5], [1.0, 1e-3, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0]];
        for rule in [SlopeRule::default(), SlopeRule::CLASSIC] {
            let found =
                rule.inverse_slope(Tensor::from_floats(gradients, &device), Tensor::from_floats(directions, &device));
            let found: Vec<f32> = found.into_data().iter::<f32>().collect();
            for ((g, w), found) in gradients.into_iter().zip(directions).zip(found) {
                let (g, w) = (glam::Vec3::from(g), glam::Vec3::from(w));
                let expected = rule.inverse_slope_of(g.dot(w), g.length() * w.length());
                assert!((found - expected).abs() <= 1e-4 * expected.abs(), "{rule:?}: {found}, not {expected}");
            }
        }
    }

    #[test]
    fn the_scale_free_rule_is_largest_at_its_epsilon_and_keeps_the_sign() {
        let rule = SlopeRule::default();
        let epsilon = rule.scale_free_epsilon().unwrap() as f32;
        let largest = rule.inverse_slope_of(epsilon, 1.0);
        assert!((largest - 0.5 / epsilon).abs() < 1e-3);
        for cosine in [-1.0f32, -0.3, -1e-3, 1e-3, 0.02, 0.5, 1.0] {
            let gain = rule.inverse_slope_of(cosine, 1.0);
            assert!(gain.abs() <= largest && gain.signum() == cosine.signum(), "{cosine}: {gain}");
        }
        assert_eq!(rule.inverse_slope_of(0.0, 0.0), 0.0);
        assert_eq!(SlopeRule::CLASSIC.scale_free_epsilon(), None);
    }

    #[test]
    fn the_clamp_of_the_reference_code_begins_below_its_epsilon_and_loses_the_sign() {
        let epsilon = 1e-3f32;
        for (slope, clamped) in [(-epsilon, -epsilon), (-0.9 * epsilon, epsilon), (0.0, epsilon), (2.0, 2.0)] {
            assert_eq!(SlopeRule::CLASSIC.inverse_slope_of(slope, 1.0), clamped.recip(), "{slope}");
        }
    }
}
