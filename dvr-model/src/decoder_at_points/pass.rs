//! A chunk of points on its way through the layers, and back.

use ndarray::ArrayView2;
use ndarray::linalg::general_mat_mul;
use pulp::NullaryFnOnce;

use super::CHUNK;
use super::layers::{Layers, Linear};
use crate::matrices::{matrix, matrix_mut};

/// What the layers are asked of some points.
#[derive(Clone, Copy)]
pub(super) struct Pass<'a> {
    pub layers: &'a Layers,
    pub parameters: &'a [f32],
    pub features: &'a [f32],
    pub object: &'a [u32],
}

/// What the points of a chunk are at the layers, a row of `hidden` numbers each.
pub(super) struct Activations {
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
    pub fn new(layers: &Layers) -> Self {
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
        matrix(&self.parameters[linear.weight.clone()], linear.weight.len() / outputs.max(1), outputs)
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
        let from = matrix(from, points, weight.nrows());
        general_mat_mul(1.0, &from, &weight, 1.0, &mut matrix_mut(to, points, outputs));
    }

    /// `net` under the condition before a block.
    #[inline(always)]
    fn modulate(&self, block: usize, from: &[f32], to: &mut [f32]) {
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
            self.modulate(block, &left[block], given);
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
        let by = matrix(by, points, outputs);
        let of_weight = &mut sum[linear.weight.clone()];
        let active = matrix(active, points, inputs);
        general_mat_mul(1.0, &active.t(), &by, 1.0, &mut matrix_mut(of_weight, inputs, outputs));
        if let Some(by_active) = by_active {
            general_mat_mul(1.0, &by, &weight.t(), 0.0, &mut matrix_mut(by_active, points, inputs));
        }
    }

    /// Adds to `sum` the gradient by the condition before a block, and takes that by what it made back to what it was given.
    #[inline(always)]
    fn modulate_back(&self, block: usize, from: &[f32], by: &mut [f32], sum: &mut [f32]) {
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
pub(super) struct Forward<'a> {
    pub pass: Pass<'a>,
    pub activations: &'a mut Activations,
    pub values: &'a mut [f32],
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
pub(super) struct Backward<'a> {
    pub pass: Pass<'a>,
    pub activations: &'a mut Activations,
    /// By the values.
    pub by: &'a [f32],
    /// By the features of the points.
    pub by_features: &'a mut [f32],
    /// By all parameters.
    pub sum: &'a mut [f32],
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
            pass.modulate_back(block, &left[block], by_left, sum);
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
