//! The gradient-free march through a residual decoder as one kernel.

mod kernel;
mod network;
mod plan;
mod root_search;

use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Cube, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{DType, Int, Shape, Tensor};
use cubecl::prelude::*;

use kernel::FOUND_COLUMNS;
use network::RAY_COLUMNS;
pub use plan::Root;
use plan::{Condition, DecoderShape, Search};

/// Parameters of a residual decoder on a GPU, as they are packed for the kernel.
#[derive(Clone, Debug)]
pub struct PackedDecoder {
    /// Layer after layer its weights `[inputs, outputs]`, row by row, then its biases; of the last layer the first
    /// column alone.
    pub weights: Tensor<1>,
    /// What the layer before each block is given of the codes of the objects, `[blocks * objects, hidden]`, to be added; twice as
    /// wide where the second half, plus one, multiplies the layer first. `None` without codes.
    pub conditions: Option<Tensor<2>>,
    /// Width of the hidden layers.
    pub hidden: usize,
    /// Residual blocks.
    pub blocks: usize,
    /// Octaves of the encoding of points.
    pub octaves: usize,
    /// Slope of the last activation for negative values.
    pub leak: f32,
}

/// Rays and how they are searched.
#[derive(Clone, Debug)]
pub struct RaySearch {
    /// Origins, `[n, 3]`.
    pub origin: Tensor<2>,
    /// Directions, `[n, 3]`.
    pub direction: Tensor<2>,
    /// Depths between which each ray is searched, `[n]` each; nothing where the second is smaller.
    pub interval: [Tensor<1>; 2],
    /// Shift of the samples of each ray, `[n]` in `[0, 1)`.
    pub jitter: Option<Tensor<1>>,
    /// The object of each ray, `[n]`.
    pub object: Option<Tensor<1, Int>>,
    /// Samples on a ray, at least 2.
    pub steps: usize,
    /// How a bracketed crossing is located.
    pub root: Root,
    /// Evaluations that this takes.
    pub root_steps: usize,
}

/// Marches rays through a decoder: `[n, 3]`, for each ray its status (0 misses, 1 hits, 2 starts inside), the depth at
/// which it hits, and the depth of the sample with the largest logit among those that were evaluated.
///
/// `None` where the device cannot run the kernel: it is not a GPU, has too little memory for a group, or
/// the numbers are not of single precision.
pub fn march_decoder(decoder: &PackedDecoder, search: &RaySearch) -> Option<Tensor<2>> {
    let device = decoder.weights.device();
    let hardware = crate::open::client(&device)?.properties().hardware.clone();
    if decoder.weights.dtype() != DType::F32 {
        return None;
    }
    let count = search.origin.dims()[0];
    let shape = decoder.shape(hardware.max_units_per_cube as usize, hardware.max_shared_memory_size)?;
    assert_eq!(decoder.weights.dims(), [shape.weights()], "a decoder's packed weights fit its shape");
    let plan = MarchPlan {
        shape,
        search: Search { root: search.root, root_steps: search.root_steps as u32, jittered: search.jitter.is_some() },
        rays_a_cube: (count / CUBES).clamp(shape.slots, MAX_ROUNDS * shape.slots) as u32,
        steps: search.steps.max(2) as u32,
        objects: decoder.conditions.as_ref().map_or(0, |rows| rows.dims()[0] / decoder.blocks.max(1)) as u32,
        leak: decoder.leak,
    };
    let conditions = match &decoder.conditions {
        Some(conditions) => conditions.clone(),
        None => Tensor::zeros([1, 1], &device),
    };
    let column = |values: &Tensor<1>| values.clone().unsqueeze_dim::<2>(1);
    let zeros = || Tensor::<2>::zeros([count, 1], &device);
    let rays = Tensor::cat(
        vec![
            search.origin.clone(),
            search.direction.clone(),
            column(&search.interval[0]),
            column(&search.interval[1]),
            search.jitter.as_ref().map_or_else(zeros, column),
            search.object.as_ref().map_or_else(zeros, |object| column(&object.clone().float())),
        ],
        1,
    );
    Some(Tensor::from_dispatch(<Dispatch as MarchOp>::march_decoder(
        rays.into_dispatch(),
        decoder.weights.clone().into_dispatch(),
        conditions.into_dispatch(),
        plan,
    )))
}

/// Groups that keep a large card busy: where there are fewer rays, each group takes on no more than it has in flight at
/// once.
const CUBES: usize = 1024;

/// Rays that a group takes on for each that it has in flight: enough for short ones to make up for long ones.
const MAX_ROUNDS: usize = 4;

/// Points that a group evaluates at once, the most first. More reuse each weight more often, and need more registers.
const SLOTS: [usize; 3] = [16, 8, 4];

/// Units per group. All of WebGPU's devices allow as many.
const MAX_UNITS: usize = 256;

impl PackedDecoder {
    /// How a group of units evaluates it; `None` where its memory is too small for that.
    fn shape(&self, max_units: usize, shared_memory: usize) -> Option<DecoderShape> {
        let units = self.hidden.next_multiple_of(32).min(MAX_UNITS).min(max_units);
        let shape = |slots| DecoderShape {
            hidden: self.hidden,
            blocks: self.blocks,
            octaves: self.octaves,
            condition: match &self.conditions {
                None => Condition::None,
                Some(conditions) if conditions.dims()[1] == 2 * self.hidden => Condition::ShiftAndScale,
                Some(_) => Condition::Shift,
            },
            units,
            slots,
        };
        SLOTS.into_iter().map(shape).find(|shape| shape.slots <= units && shape.shared_bytes() <= shared_memory)
    }
}

/// What the kernel takes beside tensors.
#[derive(Clone, Copy, Debug)]
pub struct MarchPlan {
    shape: DecoderShape,
    search: Search,
    rays_a_cube: u32,
    steps: u32,
    objects: u32,
    leak: f32,
}

/// The operation as an extension of burn's backends; use [`march_decoder`].
#[backend_extension(Cube)]
pub trait MarchOp: Backend {
    /// `[n, 10]`, `[weights]` and `[blocks * objects, hidden]` to `[n, 3]`.
    fn march_decoder(
        rays: FloatTensor<Self>,
        weights: FloatTensor<Self>,
        conditions: FloatTensor<Self>,
        plan: MarchPlan,
    ) -> FloatTensor<Self>;
}

impl MarchOp for Cube {
    fn march_decoder(
        rays: FloatTensor<Self>,
        weights: FloatTensor<Self>,
        conditions: FloatTensor<Self>,
        plan: MarchPlan,
    ) -> FloatTensor<Self> {
        let count = rays.shape()[0];
        let found = Self::float_zeros(Shape::new([count, FOUND_COLUMNS]), &rays.device(), rays.dtype().into());
        if count == 0 {
            return found;
        }
        debug_assert_eq!(rays.shape()[1], RAY_COLUMNS);
        let client = rays.client.clone();
        let cubes = (count as u32).div_ceil(plan.rays_a_cube);
        kernel::march_decoder::launch(
            &client,
            CubeCount::new_1d(cubes),
            CubeDim::new_1d(plan.shape.units as u32),
            rays.into_buffer_arg(),
            weights.into_buffer_arg(),
            conditions.into_buffer_arg(),
            found.clone().into_buffer_arg(),
            count as u32,
            plan.rays_a_cube,
            plan.steps,
            plan.objects,
            plan.leak,
            plan.shape,
            plan.search,
        );
        found
    }
}
