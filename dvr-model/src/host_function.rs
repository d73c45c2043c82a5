//! Functions of many numbers that are computed on the host, with their gradient by hand.
//!
//! What burn's graph does in some fifty operations, each of which allocates and goes through memory, is one operation here.

use std::fmt::Debug;
use std::sync::Arc;

#[cfg(feature = "gpu")]
use burn::backend::Cube;
use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind, unary};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{DType, Device, Tensor, TensorData, try_read_sync};

/// A function of numbers to numbers. What it is given besides, it holds.
pub(crate) trait HostFunction: Debug + Send + Sync {
    /// Its value.
    fn value(&self, inputs: &[f32]) -> Vec<f32>;

    /// The gradient by its inputs of what has the gradient `by` by its value.
    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32>;
}

/// Whether a parameter is a number that the CPU computes with in single precision: then a [`HostFunction`] can take it.
pub(crate) fn is_on_host<const D: usize>(parameter: &Tensor<D>) -> bool {
    let device = parameter.device();
    (device == Device::flex() || device == Device::flex().autodiff()) && parameter.dtype() == DType::F32
}

/// The value of a function, on the graph.
pub(crate) fn host_function(inputs: Tensor<1>, function: Arc<dyn HostFunction>) -> Tensor<1> {
    Tensor::from_dispatch(<Dispatch as OnHost>::host_function(inputs.into_dispatch(), function))
}

/// The operation as an extension of burn's backends; use [`host_function`].
#[backend_extension(Autodiff, Flex, Cube: cfg(feature = "gpu"))]
pub(crate) trait OnHost: Backend {
    /// `[n]` to as many numbers as the function has.
    fn host_function(inputs: FloatTensor<Self>, function: Arc<dyn HostFunction>) -> FloatTensor<Self> {
        let device = inputs.device();
        of_numbers::<Self>(function.value(&numbers::<Self>(inputs)), &device)
    }
}

impl OnHost for Flex {}

#[cfg(feature = "gpu")]
impl OnHost for Cube {}

impl<B: OnHost, C: CheckpointStrategy> OnHost for Autodiff<B, C> {
    fn host_function(inputs: FloatTensor<Self>, function: Arc<dyn HostFunction>) -> FloatTensor<Self> {
        #[derive(Debug)]
        struct ByHand;

        impl<B: Backend> Backward<B, 1> for ByHand {
            type State = (FloatTensor<B>, Arc<dyn HostFunction>);

            fn backward(self, ops: Ops<Self::State, 1>, grads: &mut Gradients, _checkpointer: &mut Checkpointer) {
                let (inputs, function) = ops.state;
                unary::<B, _>(ops.parents, ops.node, grads, |by| {
                    let device = by.device();
                    of_numbers::<B>(function.gradient(&numbers::<B>(inputs), &numbers::<B>(by)), &device)
                });
            }
        }

        match ByHand.prepare::<C>([inputs.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let inputs = inputs.into_primitive();
                let value = B::host_function(inputs.clone(), function.clone());
                prep.finish((inputs, function), value)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::host_function(inputs.into_primitive(), function)),
        }
    }
}

fn numbers<B: Backend>(tensor: FloatTensor<B>) -> Vec<f32> {
    let data = try_read_sync(B::float_into_data(tensor)).and_then(Result::ok).expect("the host reads what it computed");
    data.convert::<f32>().try_into_vec().expect("they are of single precision")
}

fn of_numbers<B: Backend>(numbers: Vec<f32>, device: &B::Device) -> FloatTensor<B> {
    let count = numbers.len();
    B::float_from_data(TensorData::new(numbers, [count]), device)
}
