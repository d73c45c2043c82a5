//! Trilinear interpolation between the nodes of a lattice as operations of burn, with their backward passes.
//!
//! The numbers come from [`dvr_kernels::interpolate`]. What a tensor version needs eight gathers and some thirty operations
//! for, each with memory of its own, is one pass here; so is its gradient.

// Upstream deprecates burn-ndarray; here it is only a second oracle, behind a feature.
#![allow(deprecated)]

use std::borrow::Cow;

#[cfg(feature = "ndarray")]
use burn::backend::NdArray;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{DType, Element, Tensor, TensorData, read_sync};
use dvr_kernels::Lattice;
use dvr_kernels::interpolate::{self as kernels, Real};

/// Values between the nodes of a lattice.
///
/// `values` are `[nodes, C]` with one or three channels a node, `points` `[n, 3]`; the answer is `[n, C]`. Gradients reach both;
/// outside the lattice's cube the answer is that of the nearest point.
pub(crate) fn interpolate(lattice: Lattice, values: Tensor<2>, points: Tensor<2>) -> Tensor<2> {
    let (values, points) = (values.into_dispatch(), points.into_dispatch());
    Tensor::from_dispatch(<Dispatch as LatticeOp>::lattice_interpolate(values, points, lattice))
}

/// The same, and beside it the derivative along a direction a point, `[n, 3]`: two tensors `[n, C]`, both of which gradients
/// pass on to values, points and directions.
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
#[cfg_attr(not(feature = "ndarray"), backend_extension(Autodiff, Flex))]
#[cfg_attr(feature = "ndarray", backend_extension(Autodiff, Flex, NdArray))]
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

/// Backends whose tensors lie in the processor's memory.
pub trait HostTensors: Backend {
    /// A tensor's numbers, row by row; copied only if they lie otherwise or are of another type.
    fn numbers<E: Number>(tensor: &FloatTensor<Self>) -> Cow<'_, [E]>;
}

/// `f32` or `f64`, for burn and for the kernels.
pub trait Number: Real + Element + bytemuck::Pod {}

impl Number for f32 {}
impl Number for f64 {}

fn copied<B: Backend, E: Number>(tensor: &FloatTensor<B>) -> Vec<E> {
    let data = read_sync(B::float_into_data(tensor.clone())).expect("a tensor in the processor's memory can be read");
    data.iter::<E>().collect()
}

impl HostTensors for Flex {
    fn numbers<E: Number>(tensor: &FloatTensor<Self>) -> Cow<'_, [E]> {
        tensor.as_slice::<E>().map_or_else(|| Cow::Owned(copied::<Self, E>(tensor)), Cow::Borrowed)
    }
}

#[cfg(feature = "ndarray")]
impl HostTensors for NdArray {
    fn numbers<E: Number>(tensor: &FloatTensor<Self>) -> Cow<'_, [E]> {
        Cow::Owned(copied::<Self, E>(tensor))
    }
}

/// Rows of three numbers, points say.
fn triples<E>(numbers: &[E]) -> &[[E; 3]] {
    numbers.as_chunks().0
}

/// A tensor of so many columns from its rows, on the device of `like`.
fn tensor<B: Backend, E: Number, const C: usize>(
    rows: Vec<[E; C]>,
    columns: usize,
    like: &FloatTensor<B>,
) -> FloatTensor<B> {
    let numbers = rows.into_flattened();
    let shape = [numbers.len() / columns, columns];
    B::float_from_data(TensorData::new(numbers, shape), &like.device())
}

/// Calls a function of backend, number type and channels with those of a tensor of values.
macro_rules! by_type {
    ($function:ident::<$backend:ty> of $values:expr, $($argument:expr),+) => {
        match ($values.dtype(), $values.shape()[1]) {
            (DType::F64, 1) => $function::<$backend, f64, 1>($($argument),+),
            (DType::F64, 3) => $function::<$backend, f64, 3>($($argument),+),
            (_, 1) => $function::<$backend, f32, 1>($($argument),+),
            (_, 3) => $function::<$backend, f32, 3>($($argument),+),
            (_, channels) => panic!("a lattice has one or three channels a node, not {channels}"),
        }
    };
}

/// What an operation was asked, to be kept for its backward pass.
#[derive(Clone, Debug)]
struct Asked<B: Backend> {
    lattice: Lattice,
    values: FloatTensor<B>,
    points: FloatTensor<B>,
}

fn forward<B: HostTensors, E: Number, const C: usize>(asked: &Asked<B>) -> FloatTensor<B> {
    let (values, points) = (B::numbers::<E>(&asked.values), B::numbers::<E>(&asked.points));
    tensor::<B, E, C>(kernels::interpolate(&asked.lattice, values.as_chunks().0, triples(&points)), C, &asked.points)
}

fn by_values<B: HostTensors, E: Number, const C: usize>(asked: &Asked<B>, by: &FloatTensor<B>) -> FloatTensor<B> {
    let (points, by) = (B::numbers::<E>(&asked.points), B::numbers::<E>(by));
    tensor::<B, E, C>(kernels::scatter(&asked.lattice, triples(&points), by.as_chunks().0), C, &asked.values)
}

fn by_points<B: HostTensors, E: Number, const C: usize>(asked: &Asked<B>, by: &FloatTensor<B>) -> FloatTensor<B> {
    let (values, points) = (B::numbers::<E>(&asked.values), B::numbers::<E>(&asked.points));
    let by = B::numbers::<E>(by);
    let values = values.as_chunks::<C>().0;
    let rows = kernels::points_gradient(&asked.lattice, values, triples(&points), by.as_chunks().0);
    tensor::<B, E, 3>(rows, 3, &asked.points)
}

fn jet_forward<B: HostTensors, E: Number, const C: usize>(
    asked: &Asked<B>,
    directions: &FloatTensor<B>,
) -> FloatTensor<B> {
    let (values, points) = (B::numbers::<E>(&asked.values), B::numbers::<E>(&asked.points));
    let directions = B::numbers::<E>(directions);
    let values = values.as_chunks::<C>().0;
    let rows = kernels::interpolate_jet(&asked.lattice, values, triples(&points), triples(&directions));
    tensor::<B, E, C>(rows.into_flattened(), 2 * C, &asked.points)
}

fn jet_by_values<B: HostTensors, E: Number, const C: usize>(
    asked: &Asked<B>,
    directions: &FloatTensor<B>,
    by: &FloatTensor<B>,
) -> FloatTensor<B> {
    let (points, directions) = (B::numbers::<E>(&asked.points), B::numbers::<E>(directions));
    let by = B::numbers::<E>(by);
    let by = by.as_chunks::<C>().0.as_chunks().0;
    tensor::<B, E, C>(
        kernels::scatter_jet(&asked.lattice, triples(&points), triples(&directions), by),
        C,
        &asked.values,
    )
}

/// Gradients by points and by directions.
fn jet_by_points<B: HostTensors, E: Number, const C: usize>(
    asked: &Asked<B>,
    directions: &FloatTensor<B>,
    by: &FloatTensor<B>,
) -> [FloatTensor<B>; 2] {
    let (values, points) = (B::numbers::<E>(&asked.values), B::numbers::<E>(&asked.points));
    let (numbers, by) = (B::numbers::<E>(directions), B::numbers::<E>(by));
    let by = by.as_chunks::<C>().0.as_chunks().0;
    let values = values.as_chunks::<C>().0;
    let rows = kernels::jet_points_gradient(&asked.lattice, values, triples(&points), triples(&numbers), by);
    let (by_points, by_directions): (Vec<_>, Vec<_>) = rows.into_iter().map(|[p, d]| (p, d)).unzip();
    [tensor::<B, E, 3>(by_points, 3, &asked.points), tensor::<B, E, 3>(by_directions, 3, directions)]
}

/// The operations of a backend in memory.
macro_rules! implement_in_memory {
    ($backend:ty) => {
        impl LatticeOp for $backend {
            fn lattice_interpolate(
                values: FloatTensor<Self>,
                points: FloatTensor<Self>,
                lattice: Lattice,
            ) -> FloatTensor<Self> {
                let asked = Asked::<Self> { lattice, values, points };
                by_type!(forward::<Self> of asked.values, &asked)
            }

            fn lattice_jet(
                values: FloatTensor<Self>,
                points: FloatTensor<Self>,
                directions: FloatTensor<Self>,
                lattice: Lattice,
            ) -> FloatTensor<Self> {
                let asked = Asked::<Self> { lattice, values, points };
                by_type!(jet_forward::<Self> of asked.values, &asked, &directions)
            }
        }
    };
}

implement_in_memory!(Flex);
#[cfg(feature = "ndarray")]
implement_in_memory!(NdArray);

#[derive(Debug)]
struct Interpolation;

impl<B: HostTensors> Backward<B, 2> for Interpolation {
    type State = Asked<B>;

    fn backward(self, ops: Ops<Self::State, 2>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let (asked, by) = (ops.state, grads.consume::<B>(&ops.node));
        let [values, points] = ops.parents;
        if let Some(node) = values {
            grads.register::<B>(node.id, by_type!(by_values::<B> of asked.values, &asked, &by));
        }
        if let Some(node) = points {
            grads.register::<B>(node.id, by_type!(by_points::<B> of asked.values, &asked, &by));
        }
    }
}

#[derive(Debug)]
struct Jet;

impl<B: HostTensors> Backward<B, 3> for Jet {
    type State = (Asked<B>, FloatTensor<B>);

    fn backward(self, ops: Ops<Self::State, 3>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
        let ((asked, directions), by) = (ops.state, grads.consume::<B>(&ops.node));
        let [values, points, along] = ops.parents;
        if let Some(node) = values {
            grads.register::<B>(node.id, by_type!(jet_by_values::<B> of asked.values, &asked, &directions, &by));
        }
        if points.is_some() || along.is_some() {
            let both = by_type!(jet_by_points::<B> of asked.values, &asked, &directions, &by);
            for (node, gradient) in [points, along].into_iter().zip(both) {
                if let Some(node) = node {
                    grads.register::<B>(node.id, gradient);
                }
            }
        }
    }
}

impl<B: LatticeOp + HostTensors, C: CheckpointStrategy> LatticeOp for Autodiff<B, C> {
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
