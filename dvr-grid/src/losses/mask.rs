//! Masks: free space on background rays that hit, occupancy on object rays that miss.
//!
//! `L = weight * softplus(s k v)`, with `v` the shape's largest value on the ray, `k` the sharpness that makes it a
//! logit, and `s` 1 where the mask says background, -1 where it says object: the cross entropy of the occupancy at the
//! ray's most occupied point (the freespace and occupancy losses of Niemeyer et al. 2020, who draw that point at random).

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::term::{LossTerm, SilhouetteTerm};

/// Free space on background rays that hit, and occupancy on object rays that miss: cross entropy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MaskLoss {
    /// Weight of the mean over rays.
    pub weight: f64,
    /// How steep the logistic function is: logits are this many times the shape's values.
    pub sharpness: f64,
}

impl Default for MaskLoss {
    fn default() -> Self {
        Self { weight: 10.0, sharpness: 100.0 }
    }
}

impl LossTerm for MaskLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    fn parameters(&self) -> Vec<(&'static str, f64, RangeInclusive<f64>)> {
        vec![("sharpness", self.sharpness, 0.0..=f64::MAX)]
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        Self { weight: 1.0, ..Self::default() }
    }
}

impl SilhouetteTerm for MaskLoss {
    fn evaluate(&self, largest: f32, sign: f32) -> (f64, f32) {
        let sharpness = self.sharpness as f32;
        let logit = sign * sharpness * largest;
        // softplus(logit) and its derivative.
        let probability = 1.0 / (1.0 + (-logit).exp());
        let value = f64::from(logit.max(0.0) + (-logit.abs()).exp().ln_1p());
        (value, self.weight as f32 * sign * sharpness * probability)
    }
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::MaskLoss;

    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Weights {
        pub weight: f32,
        pub sharpness: f32,
    }

    impl MaskLoss {
        pub(crate) fn launch(&self) -> WeightsLaunch {
            WeightsLaunch { weight: self.weight as f32, sharpness: self.sharpness as f32 }
        }
    }

    /// Adds the gradient by the largest value; returns the loss.
    #[cube]
    pub(crate) fn evaluate(weights: &Weights, largest: f32, sign: f32, grad_value: &RuntimeCell<f32>) -> f32 {
        let logit = sign * weights.sharpness * largest;
        let gradient = weights.weight * sign * weights.sharpness / (1.0f32 + (-logit).exp());
        grad_value.store(grad_value.read() + gradient);
        logit.max(0.0f32) + (1.0f32 + (-logit.abs()).exp()).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_softplus_of_the_largest_value_and_its_gradient_is_weighted() {
        let loss = MaskLoss { weight: 3.0, sharpness: 20.0 };
        assert_eq!((loss.weight(), loss.parameters()[0].1), (3.0, 20.0));
        for largest in [-0.4f32, -0.02, 0.0, 0.03, 0.5] {
            for sign in [1.0f32, -1.0] {
                let logit = f64::from(sign) * 20.0 * f64::from(largest);
                let (value, gradient) = loss.evaluate(largest, sign);
                assert!((value - (1.0 + logit.exp()).ln()).abs() < 1e-5 * (1.0 + logit.abs()), "{largest}: {value}");
                let expected = 3.0 * f64::from(sign) * 20.0 / (1.0 + (-logit).exp());
                assert!((f64::from(gradient) - expected).abs() < 1e-4, "{largest}: {gradient}, not {expected}");
            }
        }
    }
}
