//! The differentiable depth: forward it is the depth that was found, backward it is the implicit function theorem.
//!
//! From `f(r0 + d w) = 0` follows `dd = -df / s` with the slope `s = grad_p f . w` and `df` the change of `f` *at the
//! fixed point* (DVR, section 3.3, equation 7). So one operation with one differentiable input suffices: give it `f`
//! evaluated on the graph at `r0 + d_hat w`, and gradients reach whatever `f` was computed from: decoder parameters,
//! latent codes, and, if the point was put together on the graph, ray origin and direction (`dd/dr0 = -g/s`,
//! `dd/dw = -d g/s`), hence cameras.

#[cfg(feature = "gpu")]
use burn::backend::Cube;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::Tensor;

/// Depth with its analytic gradient.
///
/// * `occupancy_logit`: `f` at the fixed points `r0 + depth * w`, `[n]`, on the graph;
/// * `depth`: the ray depths that the root search found, `[n]`, constants;
/// * `inverse_slope`: `1 / (grad_p f . w)`, regularised by a [`SlopeRule`](crate::SlopeRule), `[n]`, constants.
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
#[backend_extension(Autodiff, Flex, Cube: cfg(feature = "gpu"))]
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

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    fn numbers(values: Tensor<1>) -> Vec<f32> {
        values.into_data().iter::<f32>().collect()
    }

    #[test]
    fn it_is_the_depth_and_its_gradient_is_less_the_inverse_slope() {
        let device = Device::flex().autodiff();
        let constant = |values: [f32; 3]| Tensor::<1>::from_floats(values, &device);
        let logit = constant([0.1, -0.2, 0.0]).require_grad();
        let (depth, inverse_slope) = ([1.5, 2.5, 0.25], [2.0, -0.5, 0.0]);
        // Through another operation on either side.
        let found = implicit_depth(logit.clone() * 3.0, constant(depth), constant(inverse_slope));
        assert_eq!(numbers(found.clone()), depth);
        let gradients = (found * constant([1.0, 10.0, 5.0])).sum().backward();
        assert_eq!(numbers(Tensor::from_inner(logit.grad(&gradients).unwrap())), [-6.0, 15.0, 0.0]);
    }

    #[test]
    fn without_a_graph_it_is_the_depth() {
        for device in [Device::flex(), Device::flex().autodiff()] {
            let constant = |values: [f32; 2]| Tensor::<1>::from_floats(values, &device);
            let found = implicit_depth(constant([0.3, 0.4]), constant([1.5, 2.5]), constant([2.0, 2.0]));
            assert_eq!(numbers(found), [1.5, 2.5]);
        }
    }
}
