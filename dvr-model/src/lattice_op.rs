//! Trilinear interpolation between the nodes of a lattice as operations of burn, with their backward passes.
//!
//! The numbers come from [`dvr_kernels::interpolate`], or on a graphics processor from its own kernels. What a tensor
//! version needs eight gathers and some thirty operations for, each with memory of its own, is one pass here; so is its
//! gradient.

// Upstream deprecates burn-ndarray; here it is a second opinion behind a feature.
#![allow(deprecated)]

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, backend_extension};
use burn::tensor::Tensor;
use dvr_kernels::Lattice;

/// Values between the nodes of a lattice.
///
/// `values` are `[nodes, C]` with one or three channels a node, `points` `[n, 3]`; the answer is `[n, C]`. Gradients
/// reach both; outside the lattice's cube the answer is that of the nearest point.
pub(crate) fn interpolate(lattice: Lattice, values: Tensor<2>, points: Tensor<2>) -> Tensor<2> {
    let (values, points) = (values.into_dispatch(), points.into_dispatch());
    Tensor::from_dispatch(<Dispatch as LatticeOp>::lattice_interpolate(values, points, lattice))
}

/// The same, and beside it the derivative along a direction a point, `[n, 3]`: two tensors `[n, C]`, both of which
/// gradients pass on to values, points and directions.
pub(crate) fn interpolate_jet(
    lattice: Lattice,
    values: Tensor<2>,
    points: Tensor<2>,
    directions: Tensor<2>,
) -> [Tensor<2>; 2] {
    let channels = values.dims()[1];
    let (values, points, directions) = (values.into_dispatch(), points.into_dispatch(), directions.into_dispatch());
    let jet = Tensor::<2>::from_dispatch(<Dispatch as LatticeOp>::lattice_jet(values, points, directions, lattice));
    [jet.clone().narrow(1, 0, channels), jet.narrow(1, channels, channels)]
}

/// The operations as an extension of burn's backends; use [`interpolate`] and [`interpolate_jet`].
#[backend_extension(Autodiff, Flex, NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "gpu"))]
pub trait LatticeOp: Backend {
    /// `[nodes, C]` and `[n, 3]` to `[n, C]`.
    fn lattice_interpolate(values: FloatTensor<Self>, points: FloatTensor<Self>, lattice: Lattice)
    -> FloatTensor<Self>;

    /// `[nodes, C]`, `[n, 3]` and `[n, 3]` to `[n, 2 C]`: values, then derivatives.
    fn lattice_jet(
        values: FloatTensor<Self>,
        points: FloatTensor<Self>,
        directions: FloatTensor<Self>,
        lattice: Lattice,
    ) -> FloatTensor<Self>;
}

/// What an operation was asked, to be kept for its backward pass.
#[derive(Clone, Debug)]
pub struct Asked<B: Backend> {
    /// Where the nodes lie.
    pub lattice: Lattice,
    /// `[nodes, C]`.
    pub values: FloatTensor<B>,
    /// `[n, 3]`.
    pub points: FloatTensor<B>,
}

/// The transposes of the operations, for their backward passes.
pub trait LatticeGradients: LatticeOp {
    /// The gradient by the nodes' values, `[nodes, C]`, from that by the answers, `[n, C]`; with `directions`, from
    /// `[n, 2 C]`.
    fn by_values(
        asked: &Asked<Self>,
        directions: Option<&FloatTensor<Self>>,
        by: &FloatTensor<Self>,
    ) -> FloatTensor<Self>;

    /// The gradient by the points, `[n, 3]`, from that by values, `[n, C]`.
    fn by_points(asked: &Asked<Self>, by: &FloatTensor<Self>) -> FloatTensor<Self>;

    /// The gradients by points and by directions, `[n, 3]` each, from that by values and derivatives, `[n, 2 C]`.
    fn jet_by_points(
        asked: &Asked<Self>,
        directions: &FloatTensor<Self>,
        by: &FloatTensor<Self>,
    ) -> [FloatTensor<Self>; 2];
}

#[derive(Debug)]
struct Interpolation;

impl<B: LatticeGradients> Backward<B, 2> for Interpolation {
    type State = Asked<B>;

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let (asked, by) = (ops.state, grads.consume::<B>(&ops.node));
        let [values, points] = ops.parents;
        if let Some(node) = values {
            grads.register::<B>(node.id, B::by_values(&asked, None, &by));
        }
        if let Some(node) = points {
            grads.register::<B>(node.id, B::by_points(&asked, &by));
        }
    }
}

#[derive(Debug)]
struct Jet;

impl<B: LatticeGradients> Backward<B, 3> for Jet {
    type State = (Asked<B>, FloatTensor<B>);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let ((asked, directions), by) = (ops.state, grads.consume::<B>(&ops.node));
        let [values, points, along] = ops.parents;
        if let Some(node) = values {
            grads.register::<B>(node.id, B::by_values(&asked, Some(&directions), &by));
        }
        if points.is_some() || along.is_some() {
            let both = B::jet_by_points(&asked, &directions, &by);
            for (node, gradient) in [points, along].into_iter().zip(both) {
                if let Some(node) = node {
                    grads.register::<B>(node.id, gradient);
                }
            }
        }
    }
}

impl<B: LatticeGradients, C: CheckpointStrategy> LatticeOp for Autodiff<B, C> {
    fn lattice_interpolate(
        values: FloatTensor<Self>,
        points: FloatTensor<Self>,
        lattice: Lattice,
    ) -> FloatTensor<Self> {
        let nodes = [values.node(), points.node()];
        let asked = Asked::<B> { lattice, values: values.into_primitive(), points: points.into_primitive() };
        let output = B::lattice_interpolate(asked.values.clone(), asked.points.clone(), lattice);
        match Interpolation.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(asked, output),
            OpsKind::UnTracked(prep) => prep.finish(output),
        }
    }

    fn lattice_jet(
        values: FloatTensor<Self>,
        points: FloatTensor<Self>,
        directions: FloatTensor<Self>,
        lattice: Lattice,
    ) -> FloatTensor<Self> {
        let nodes = [values.node(), points.node(), directions.node()];
        let asked = Asked::<B> { lattice, values: values.into_primitive(), points: points.into_primitive() };
        let directions = directions.into_primitive();
        let output = B::lattice_jet(asked.values.clone(), asked.points.clone(), directions.clone(), lattice);
        match Jet.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish((asked, directions), output),
            OpsKind::UnTracked(prep) => prep.finish(output),
        }
    }
}
