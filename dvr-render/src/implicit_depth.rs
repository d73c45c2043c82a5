//! The differentiable depth: forward it is the depth that was found, backward it is the implicit function theorem.
//!
//! From `f(r0 + d w) = 0` follows `dd = -df / s` with the slope `s = grad_p f . w` and `df` the change of `f` *at the
//! fixed point* (DVR, section 3.3, equation 7). So one operation with one differentiable input suffices: give it `f`
//! evaluated on the graph at `r0 + d_hat w`, and gradients reach whatever `f` was computed from: decoder parameters,
//! latent codes, and, if the point was put together on the graph, ray origin and direction (`dd/dr0 = -g/s`,
//! `dd/dw = -d g/s`), hence cameras.

// Upstream deprecates burn-ndarray; here it is only a second oracle, behind a feature.
#![allow(deprecated)]

#[cfg(feature = "gpu")]
use burn::backend::Cube;
#[cfg(feature = "ndarray")]
use burn::backend::NdArray;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
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
    /// The reference's clamp: slopes with `|s| < epsilon` become `+epsilon`, which depends on the scale of `f` and
    /// flips the sign of small negative slopes. Kept so that old results can be reproduced.
    Classic {
        /// The threshold; 1e-3 in the reference.
        epsilon: f64,
    },
}

impl Default for SlopeRule {
    /// Scale-free, damped below 3 degrees of grazing incidence.
    fn default() -> Self {
        Self::ScaleFree { epsilon: 0.05 }
    }
}

impl SlopeRule {
    /// The reference implementation's rule.
    pub const CLASSIC: Self = Self::Classic { epsilon: 1e-3 };

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

/// Depth with its analytic gradient.
///
/// * `occupancy_logit`: `f` at the fixed points `r0 + depth * w`, `[n]`, on the graph;
/// * `depth`: the ray depths that the root search found, `[n]`, constants;
/// * `inverse_slope`: `1 / (grad_p f . w)`, regularised by a [`SlopeRule`], `[n]`, constants.
///
/// Returns `depth`, `[n]`, whose gradient towards `occupancy_logit` is `-inverse_slope`.
pub fn implicit_depth(occupancy_logit: Tensor<1>, depth: Tensor<1>, inverse_slope: Tensor<1>) -> Tensor<1> {
    Tensor::from_dispatch(<Dispatch as ImplicitDepth>::implicit_depth(
        occupancy_logit.into_dispatch(),
        depth.into_dispatch(),
        inverse_slope.into_dispatch(),
    ))
}

/// The operation as an extension of burn's backends; use [`implicit_depth`].
#[backend_extension(Autodiff, Flex, NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "gpu"))]
pub trait ImplicitDepth: Backend {
    /// Returns `depth` unchanged; only the autodiff backend has more to do.
    fn implicit_depth(
        occupancy_logit: FloatTensor<Self>,
        depth: FloatTensor<Self>,
        inverse_slope: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        let _ = (occupancy_logit, inverse_slope);
        depth
    }
}

impl ImplicitDepth for Flex {}

#[cfg(feature = "ndarray")]
impl ImplicitDepth for NdArray {}

#[cfg(feature = "gpu")]
impl ImplicitDepth for Cube {}

impl<B: ImplicitDepth, C: CheckpointStrategy> ImplicitDepth for Autodiff<B, C> {
    fn implicit_depth(
        occupancy_logit: FloatTensor<Self>,
        depth: FloatTensor<Self>,
        inverse_slope: FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct ImplicitFunctionTheorem;

        impl<B: Backend> Backward<B, 1> for ImplicitFunctionTheorem {
            type State = FloatTensor<B>;

            fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
                let inverse_slope = ops.state;
                unary::<B, _>(ops.parents, ops.node, grads, |grad| B::float_neg(B::float_mul(grad, inverse_slope)));
            }
        }

        match ImplicitFunctionTheorem.prepare::<C>([occupancy_logit.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(inverse_slope.into_primitive(), depth.into_primitive()),
            OpsKind::UnTracked(prep) => prep.finish(depth.into_primitive()),
        }
    }
}
