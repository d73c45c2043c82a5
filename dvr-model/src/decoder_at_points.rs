//! The decoder at many points on the CPU, with its gradient by hand: what training by points of known occupancy costs.
//!
//! [`Decoder::outputs`] in burn's operations keeps some fifty tensors of a row per point for the backward pass, and does little
//! with each. Here a share of the points goes through all layers while it is in the cache; the backward pass goes through them
//! once more, so that nothing is kept.

use std::ops::Range;
use std::sync::Arc;

use burn::tensor::{Int, Tensor};
use ndarray::linalg::general_mat_mul;
use ndarray::{ArrayView2, ArrayViewMut2};
use pulp::{Arch, NullaryFnOnce};
use rayon::prelude::*;

use crate::decoder::{Decoder, LEAK};
use crate::encoding;
use crate::host_function::{HostFunction, host_function};

/// Points that go through the layers together: few enough for the cache.
const CHUNK: usize = 128;

/// Parts that gradients are summed in, whatever the threads: the same bits on every machine with as many.
const PARTS: usize = 8;

/// Values of a point: the occupancy logit, and the colour before the sigmoid.
const OUTPUTS: usize = 4;

/// [`Decoder::outputs`] without features of pictures, `[n, 4]`; `object` picks the row of `conditions` for each point, and
/// without it all have the first.
pub(crate) fn decoder_at_points(
    decoder: &Decoder,
    points: Tensor<2>,
    conditions: &[Tensor<2>],
    object: Option<&Tensor<1, Int>>,
) -> Tensor<2> {
    let features = encoding::encode(points, decoder.octaves);
    let [count, per_point] = features.dims();
    let [objects, given] = conditions.first().map_or([0, 0], Tensor::dims);
    let layers = Layers {
        points: count,
        features: per_point,
        hidden: decoder.fc_p.weight.dims()[1],
        blocks: decoder.blocks.len(),
        conditions: conditions.len(),
        objects,
        given,
        leak: if decoder.leaky { LEAK as f32 } else { 0.0 },
    };
    let object: Vec<u32> = match object {
        Some(object) if layers.conditions > 0 => object.clone().into_data().iter::<i64>().map(|i| i as u32).collect(),
        _ => vec![0; count],
    };
    let linears = std::iter::once(&decoder.fc_p)
        .chain(decoder.blocks.iter().flat_map(|block| [&block.fc_0, &block.fc_1]))
        .chain([&decoder.fc_out]);
    let mut inputs: Vec<Tensor<1>> = Vec::new();
    for linear in linears {
        let outputs = linear.weight.dims()[1];
        inputs.push(linear.weight.val().flatten(0, 1));
        inputs.push(match &linear.bias {
            Some(bias) => bias.val(),
            None => Tensor::zeros([outputs], &features.device()),
        });
    }
    inputs.extend(conditions.iter().map(|condition| condition.clone().flatten(0, 1)));
    inputs.push(features.flatten(0, 1));
    let function = Arc::new(AtPoints { layers, object });
    host_function(Tensor::cat(inputs, 0), function).reshape([count, OUTPUTS])
}

/// The sizes of a decoder, and where its numbers lie among the inputs: first layer, blocks and last layer, each a weight
/// `[inputs, outputs]` and a bias; what codes make of the layer before each block; features of the points.
#[derive(Clone, Copy, Debug)]
struct Layers {
    points: usize,
    /// Numbers that a point gives to the first layer.
    features: usize,
    hidden: usize,
    blocks: usize,
    /// Blocks with a condition before them: none or all.
    conditions: usize,
    objects: usize,
    /// Numbers of a condition: `hidden` that shift, or as many again that scale, after them.
    given: usize,
    /// Slope of the last activation below zero.
    leak: f32,
}

/// A linear layer among the inputs.
struct Linear {
    weight: Range<usize>,
    bias: Range<usize>,
}

impl Layers {
    fn linear(at: usize, inputs: usize, outputs: usize) -> Linear {
        let weight = at..at + inputs * outputs;
        Linear { bias: weight.end..weight.end + outputs, weight }
    }

    fn input(&self) -> Linear {
        Self::linear(0, self.features, self.hidden)
    }

    /// The layers of a block.
    fn block(&self, i: usize) -> [Linear; 2] {
        let size = (self.hidden + 1) * self.hidden;
        [2 * i, 2 * i + 1].map(|layer| Self::linear(self.input().bias.end + layer * size, self.hidden, self.hidden))
    }

    fn output(&self) -> Linear {
        let size = (self.hidden + 1) * self.hidden;
        Self::linear(self.input().bias.end + 2 * self.blocks * size, self.hidden, OUTPUTS)
    }

    /// What is given to an object before a block.
    fn condition(&self, block: usize, object: usize) -> Range<usize> {
        let first = self.output().bias.end + (block * self.objects + object) * self.given;
        first..first + self.given
    }

    /// All that is the same for all points.
    fn parameters(&self) -> Range<usize> {
        0..self.output().bias.end + self.conditions * self.objects * self.given
    }

    fn scales(&self) -> bool {
        self.given == 2 * self.hidden
    }
}

/// The function: of which object each point is.
#[derive(Debug)]
struct AtPoints {
    layers: Layers,
    object: Vec<u32>,
}

impl HostFunction for AtPoints {
    fn value(&self, inputs: &[f32]) -> Vec<f32> {
        let Layers { features: per_point, .. } = self.layers;
        let (parameters, features) = inputs.split_at(self.layers.parameters().end);
        let mut values = vec![0.0; OUTPUTS * self.layers.points];
        let parts = values.par_chunks_mut(OUTPUTS * CHUNK).zip(features.par_chunks(per_point * CHUNK));
        parts.zip(self.object.par_chunks(CHUNK)).for_each_init(
            || Activations::new(&self.layers),
            |activations, ((values, features), object)| {
                let pass = Pass { layers: &self.layers, parameters, features, object };
                Arch::new().dispatch(Forward { pass, activations, values });
            },
        );
        values
    }

    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32> {
        let Layers { features: per_point, points, .. } = self.layers;
        let (parameters, features) = inputs.split_at(self.layers.parameters().end);
        let part = points.div_ceil(CHUNK).div_ceil(PARTS).max(1) * CHUNK;
        let mut gradient = vec![0.0; inputs.len()];
        let (total, by_features) = gradient.split_at_mut(parameters.len());
        let parts = by_features.par_chunks_mut(per_point * part).zip(features.par_chunks(per_point * part));
        let parts = parts.zip(self.object.par_chunks(part)).zip(by.par_chunks(OUTPUTS * part));
        let sums = parts.map(|(((by_features, features), object), by)| {
            let (mut sum, mut activations) = (vec![0.0; parameters.len()], Activations::new(&self.layers));
            let chunks = by_features.chunks_mut(per_point * CHUNK).zip(features.chunks(per_point * CHUNK));
            for (((by_features, features), object), by) in
                chunks.zip(object.chunks(CHUNK)).zip(by.chunks(OUTPUTS * CHUNK))
            {
                let pass = Pass { layers: &self.layers, parameters, features, object };
                Arch::new().dispatch(Backward { pass, activations: &mut activations, by, by_features, sum: &mut sum });
            }
            sum
        });
        for sum in sums.collect::<Vec<_>>() {
            total.iter_mut().zip(sum).for_each(|(total, sum)| *total += sum);
        }
        gradient
    }
}

/// What the layers are asked of some points.
#[derive(Clone, Copy)]
struct Pass<'a> {
    layers: &'a Layers,
    parameters: &'a [f32],
    features: &'a [f32],
    object: &'a [u32],
}

/// What the points of a chunk are at the layers, a row of `hidden` numbers each.
struct Activations {
    /// Before each block, and behind the last: what the block before left, and the same under the condition.
    left: Vec<Vec<f32>>,
    given: Vec<Vec<f32>>,
    /// Between the layers of each block.
    inner: Vec<Vec<f32>>,
    /// What comes out of an activation.
    active: Vec<f32>,
    /// Gradients: by what a block leaves, and within it.
    by_left: Vec<f32>,
    by_inner: Vec<f32>,
}

impl Activations {
    fn new(layers: &Layers) -> Self {
        let rows = || vec![0.0; CHUNK * layers.hidden];
        let (each, next) = (|| (0..layers.blocks).map(|_| rows()).collect(), layers.blocks + 1);
        Self {
            left: (0..next).map(|_| rows()).collect(),
            given: each(),
            inner: each(),
            active: rows(),
            by_left: rows(),
            by_inner: rows(),
        }
    }
}

impl<'a> Pass<'a> {
    fn points(&self) -> usize {
        self.object.len()
    }

    fn weight(&self, linear: &Linear) -> ArrayView2<'a, f32> {
        let outputs = linear.bias.len();
        rows(&self.parameters[linear.weight.clone()], linear.weight.len() / outputs.max(1), outputs)
    }

    /// `to = from W + b`, or `to = from W + b + residual`.
    #[inline(always)]
    fn apply(&self, linear: &Linear, from: &[f32], residual: Option<&[f32]>, to: &mut [f32]) {
        let bias = &self.parameters[linear.bias.clone()];
        let (points, outputs) = (self.points(), bias.len());
        for (i, to) in to[..points * outputs].chunks_exact_mut(outputs).enumerate() {
            match residual {
                Some(residual) => {
                    let residual = &residual[i * outputs..(i + 1) * outputs];
                    to.iter_mut().zip(residual).zip(bias).for_each(|((to, residual), bias)| *to = residual + bias);
                }
                None => to.copy_from_slice(bias),
            }
        }
        let weight = self.weight(linear);
        let from = rows(from, points, weight.nrows());
        general_mat_mul(1.0, &from, &weight, 1.0, &mut rows_mut(to, points, outputs));
    }

    /// `net` under the condition before a block.
    #[inline(always)]
    fn condition(&self, block: usize, from: &[f32], to: &mut [f32]) {
        let hidden = self.layers.hidden;
        let nets = from.chunks_exact(hidden).zip(to.chunks_exact_mut(hidden));
        for ((from, to), object) in nets.zip(self.object) {
            if self.layers.conditions == 0 {
                to.copy_from_slice(from);
                continue;
            }
            let given = &self.parameters[self.layers.condition(block, *object as usize)];
            let (shift, scale) = given.split_at(hidden);
            if self.layers.scales() {
                let factors = scale.iter().zip(shift);
                let nets = to.iter_mut().zip(from).zip(factors);
                nets.for_each(|((to, from), (scale, shift))| *to = from * (1.0 + scale) + shift);
            } else {
                to.iter_mut().zip(from).zip(shift).for_each(|((to, from), shift)| *to = from + shift);
            }
        }
    }

    /// All layers but the last.
    #[inline(always)]
    fn forward(&self, activations: &mut Activations) {
        let Activations { left, given, inner, active, .. } = activations;
        self.apply(&self.layers.input(), self.features, None, &mut left[0]);
        for block in 0..self.layers.blocks {
            let [first, second] = self.layers.block(block);
            let (given, inner) = (&mut given[block], &mut inner[block]);
            self.condition(block, &left[block], given);
            activate(given, 0.0, active);
            self.apply(&first, active, None, inner);
            activate(inner, 0.0, active);
            self.apply(&second, active, Some(given), &mut left[block + 1]);
        }
        activate(&left[self.layers.blocks], self.layers.leak, active);
    }

    /// Adds to `sum` the gradient by a layer that `active` went into, given that by what came out, and writes that by `active`
    /// where it is asked for.
    #[inline(always)]
    fn apply_back(&self, linear: &Linear, active: &[f32], by: &[f32], sum: &mut [f32], by_active: Option<&mut [f32]>) {
        let (points, outputs) = (self.points(), linear.bias.len());
        let weight = self.weight(linear);
        let inputs = weight.nrows();
        let of_bias = &mut sum[linear.bias.clone()];
        for by in by[..points * outputs].chunks_exact(outputs) {
            of_bias.iter_mut().zip(by).for_each(|(sum, by)| *sum += by);
        }
        let by = rows(by, points, outputs);
        let of_weight = &mut sum[linear.weight.clone()];
        let active = rows(active, points, inputs);
        general_mat_mul(1.0, &active.t(), &by, 1.0, &mut rows_mut(of_weight, inputs, outputs));
        if let Some(by_active) = by_active {
            general_mat_mul(1.0, &by, &weight.t(), 0.0, &mut rows_mut(by_active, points, inputs));
        }
    }

    /// Adds to `sum` the gradient by the condition before a block, and takes that by what it made back to what it was given.
    #[inline(always)]
    fn condition_back(&self, block: usize, from: &[f32], by: &mut [f32], sum: &mut [f32]) {
        if self.layers.conditions == 0 {
            return;
        }
        let hidden = self.layers.hidden;
        let nets = from.chunks_exact(hidden).zip(by.chunks_exact_mut(hidden));
        for ((from, by), object) in nets.zip(self.object) {
            let range = self.layers.condition(block, *object as usize);
            let (by_shift, by_scale) = sum[range.clone()].split_at_mut(hidden);
            by_shift.iter_mut().zip(&*by).for_each(|(sum, by)| *sum += by);
            if self.layers.scales() {
                let scale = &self.parameters[range][hidden..];
                for (((by_scale, from), by), scale) in by_scale.iter_mut().zip(from).zip(by).zip(scale) {
                    *by_scale += *by * from;
                    *by *= 1.0 + scale;
                }
            }
        }
    }
}

/// The values of a chunk.
struct Forward<'a> {
    pass: Pass<'a>,
    activations: &'a mut Activations,
    values: &'a mut [f32],
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { pass, activations, values } = self;
        pass.forward(activations);
        pass.apply(&pass.layers.output(), &activations.active, None, values);
    }
}

/// The gradient of a chunk, added to those before it.
struct Backward<'a> {
    pass: Pass<'a>,
    activations: &'a mut Activations,
    /// By the values.
    by: &'a [f32],
    /// By the features of the points.
    by_features: &'a mut [f32],
    /// By all parameters.
    sum: &'a mut [f32],
}

impl NullaryFnOnce for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { pass, activations, by, by_features, sum } = self;
        let layers = pass.layers;
        pass.forward(activations);
        let Activations { left, given, inner, active, by_left, by_inner } = activations;
        pass.apply_back(&layers.output(), active, by, sum, Some(by_left));
        deactivate(&left[layers.blocks], layers.leak, by_left);
        for block in (0..layers.blocks).rev() {
            let [first, second] = layers.block(block);
            activate(&inner[block], 0.0, active);
            pass.apply_back(&second, active, by_left, sum, Some(by_inner));
            deactivate(&inner[block], 0.0, by_inner);
            activate(&given[block], 0.0, active);
            // What was between the layers is not needed any more.
            let by_active = &mut inner[block];
            pass.apply_back(&first, active, by_inner, sum, Some(by_active));
            deactivate(&given[block], 0.0, by_active);
            by_left.iter_mut().zip(&*by_active).for_each(|(by, more)| *by += more);
            pass.condition_back(block, &left[block], by_left, sum);
        }
        pass.apply_back(&layers.input(), pass.features, by_left, sum, Some(by_features));
    }
}

/// A leaky ReLU.
#[inline(always)]
fn activate(from: &[f32], leak: f32, to: &mut [f32]) {
    to.iter_mut().zip(from).for_each(|(to, &from)| *to = if from > 0.0 { from } else { leak * from });
}

/// Takes a gradient back through a leaky ReLU of `from`.
#[inline(always)]
fn deactivate(from: &[f32], leak: f32, by: &mut [f32]) {
    by.iter_mut().zip(from).for_each(|(by, &from)| *by = if from > 0.0 { *by } else { leak * *by });
}

fn rows(numbers: &[f32], count: usize, width: usize) -> ArrayView2<'_, f32> {
    ArrayView2::from_shape((count, width), &numbers[..count * width]).expect("as many numbers")
}

fn rows_mut(numbers: &mut [f32], count: usize, width: usize) -> ArrayViewMut2<'_, f32> {
    ArrayViewMut2::from_shape((count, width), &mut numbers[..count * width]).expect("as many numbers")
}

#[cfg(test)]
mod tests {
    use burn::module::{Module, ModuleMapper, Param};
    use burn::tensor::{Device, TensorData};
    use dvr_test_support::largest;

    use super::*;
    use crate::decoder::DecoderConfig;
    use crate::seeded;

    /// Second layers of blocks are fresh zeros, which would hide what is wrong before them.
    struct NoZeros;

    impl ModuleMapper for NoZeros {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            param.map(|tensor| {
                let shape = tensor.dims();
                let changed = waves(shape, 0.1, &tensor.device()).inner() + tensor.inner();
                Tensor::from_inner(changed).require_grad()
            })
        }
    }

    fn waves<const D: usize>(shape: [usize; D], height: f32, device: &Device) -> Tensor<D> {
        let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| height * (1.7 * i as f32).sin()).collect();
        Tensor::from_data(TensorData::new(values, shape), device)
    }

    fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.into_data().iter::<f32>().collect()
    }

    /// Values and gradients, by points, codes and some parameters, of one way to compute them.
    fn found(
        decoder: &Decoder,
        points: usize,
        outputs: impl Fn(Tensor<2>, &[Tensor<2>], Option<&Tensor<1, Int>>) -> Tensor<2>,
    ) -> Vec<Vec<f32>> {
        let device = decoder.fc_p.weight.val().device();
        let at = waves([points, 3], 0.5, &device).require_grad();
        let code_dim = decoder.fc_c.first().map_or(0, |fc_c| fc_c.weight.dims()[0]);
        let codes = (code_dim > 0).then(|| waves([3, code_dim], 1.0, &device).require_grad());
        let owner: Vec<i64> = (0..points as i64).map(|i| (i * i + i / 50) % 3).collect();
        let object = codes.as_ref().map(|_| Tensor::from_data(TensorData::new(owner, [points]), &device));
        let values = outputs(at.clone(), &decoder.conditions(codes.clone()), object.as_ref());
        let weights = waves([points, OUTPUTS], 1.0, &device);
        let gradients = (values.clone() * weights).sum().backward();
        let of = |tensor: Tensor<2>| numbers(tensor.grad(&gradients).expect("a gradient"));
        let of_bias = |linear: &burn::nn::Linear| {
            let bias = linear.bias.as_ref().expect("a bias");
            numbers(bias.val().grad(&gradients).expect("a gradient"))
        };
        let mut all = vec![numbers(values), of(at), of(decoder.fc_p.weight.val()), of(decoder.fc_out.weight.val())];
        all.extend([of_bias(&decoder.fc_p), of_bias(&decoder.fc_out)]);
        all.extend(codes.map(of));
        all.extend(decoder.fc_c.iter().map(|fc_c| of(fc_c.weight.val())));
        for block in &decoder.blocks {
            all.extend([of(block.fc_0.weight.val()), of(block.fc_1.weight.val())]);
            all.extend([of_bias(&block.fc_0), of_bias(&block.fc_1)]);
        }
        all
    }

    #[test]
    fn values_and_gradients_are_those_of_burns_operations() {
        let device = Device::flex().autodiff();
        let plain = DecoderConfig::new().with_hidden(24).with_blocks(3);
        let coded = plain.clone().with_code_dim(5).with_octaves(2);
        let configs = [plain.with_leaky(true), coded.clone(), coded.clone().with_film(true), coded.with_blocks(0)];
        for config in configs {
            let decoder = seeded(&device, 3, || config.init(&device)).map(&mut NoZeros);
            // One chunk that is not full, and more chunks than parts.
            for points in [37, CHUNK * PARTS + 300] {
                let expected =
                    found(&decoder, points, |at, conditions, object| decoder.outputs(at, conditions, object, None));
                let ours = found(&decoder, points, |at, conditions, object| {
                    decoder_at_points(&decoder, at, conditions, object)
                });
                assert_eq!(ours.len(), expected.len());
                for (i, (ours, expected)) in ours.iter().zip(&expected).enumerate() {
                    let size = largest(expected.iter().map(|x| x.abs()));
                    let apart = largest(ours.iter().zip(expected).map(|(a, b)| (a - b).abs()));
                    assert!(size > 0.0 && apart < 2e-5 * size, "{config:?}, {points} points, {i}: {apart} of {size}");
                }
            }
        }
    }

    #[test]
    fn gradients_are_the_same_bits_whatever_the_threads() {
        let device = Device::flex().autodiff();
        let config = DecoderConfig::new().with_hidden(16).with_code_dim(4).with_film(true);
        let decoder = seeded(&device, 3, || config.init(&device)).map(&mut NoZeros);
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                found(&decoder, 1500, |at, conditions, object| decoder_at_points(&decoder, at, conditions, object))
            })
        };
        assert!(with(1) == with(3));
    }
}
