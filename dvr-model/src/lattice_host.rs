//! The lattice operations of backends whose tensors lie in the processor's memory.

// Upstream deprecates burn-ndarray; here it is only a second oracle, behind a feature.
#![allow(deprecated)]

use std::borrow::Cow;

#[cfg(feature = "ndarray")]
use burn::backend::NdArray;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Flex, TensorMetadata};
use burn::tensor::{DType, Element, TensorData, read_sync};
use dvr_kernels::Lattice;
use dvr_kernels::interpolate::{self as kernels, Real};

use crate::lattice_op::{Asked, LatticeGradients, LatticeOp};

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

        impl LatticeGradients for $backend {
            fn by_values(
                asked: &Asked<Self>,
                directions: Option<&FloatTensor<Self>>,
                by: &FloatTensor<Self>,
            ) -> FloatTensor<Self> {
                match directions {
                    None => by_type!(by_values::<Self> of asked.values, asked, by),
                    Some(directions) => by_type!(jet_by_values::<Self> of asked.values, asked, directions, by),
                }
            }

            fn by_points(asked: &Asked<Self>, by: &FloatTensor<Self>) -> FloatTensor<Self> {
                by_type!(by_points::<Self> of asked.values, asked, by)
            }

            fn jet_by_points(
                asked: &Asked<Self>,
                directions: &FloatTensor<Self>,
                by: &FloatTensor<Self>,
            ) -> [FloatTensor<Self>; 2] {
                by_type!(jet_by_points::<Self> of asked.values, asked, directions, by)
            }
        }
    };
}

implement_in_memory!(Flex);
#[cfg(feature = "ndarray")]
implement_in_memory!(NdArray);
