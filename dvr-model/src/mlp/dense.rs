//! One fully connected layer, its weights in the order in which tiles read them.

use std::sync::Arc;

/// A layer `O = I W + b` as burn has it.
#[derive(Clone, Copy, Debug)]
pub struct LinearWeights<'a> {
    /// `W`, `[inputs, outputs]`, row by row.
    pub weight: &'a [f32],
    /// `b`, one number per output.
    pub bias: &'a [f32],
    /// How many inputs there are.
    pub inputs: usize,
}

impl LinearWeights<'_> {
    /// How many outputs there are.
    pub fn outputs(&self) -> usize {
        self.bias.len()
    }
}

/// Outputs that lie side by side in the packed weights.
pub(super) const BLOCK: usize = 8;

/// Weights of [`BLOCK`] outputs for each input, then the next outputs: `[outputs / BLOCK][inputs][BLOCK]`, filled up
/// with zeros. Networks of several objects share them.
type PackedWeights = Arc<[[f32; BLOCK]]>;

/// A layer.
#[derive(Clone, Debug)]
pub(super) struct Dense {
    weights: PackedWeights,
    bias: Vec<f32>,
    inputs: usize,
    outputs: usize,
}

impl Dense {
    pub(super) fn new(layer: LinearWeights) -> Self {
        let (inputs, outputs) = (layer.inputs, layer.outputs());
        assert_eq!(layer.weight.len(), inputs * outputs, "weights of {inputs} inputs and {outputs} outputs");
        let padded = outputs.next_multiple_of(BLOCK);
        let weight = |input: usize, output: usize| {
            if output < outputs { layer.weight[input * outputs + output] } else { 0.0 }
        };
        let packed = (0..padded / BLOCK)
            .flat_map(|block| (0..inputs).map(move |input| (block, input)))
            .map(|(block, input)| std::array::from_fn(|i| weight(input, block * BLOCK + i)));
        let mut bias = layer.bias.to_vec();
        bias.resize(padded, 0.0);
        Self { weights: packed.collect(), bias, inputs, outputs }
    }

    /// Adds to the bias.
    pub(super) fn shift(&mut self, shift: &[f32]) {
        assert_eq!(shift.len(), self.outputs, "one number per output");
        self.bias.iter_mut().zip(shift).for_each(|(bias, shift)| *bias += shift);
    }

    pub(super) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(super) fn outputs(&self) -> usize {
        self.outputs
    }

    /// Outputs, filled up to whole blocks.
    pub(super) fn padded_outputs(&self) -> usize {
        self.bias.len()
    }

    /// The weights of block `i`, one row per input, and its biases.
    pub(super) fn block(&self, i: usize) -> (&[[f32; BLOCK]], &[f32]) {
        (&self.weights[i * self.inputs..(i + 1) * self.inputs], &self.bias[i * BLOCK..(i + 1) * BLOCK])
    }

    pub(super) fn blocks(&self) -> usize {
        self.padded_outputs() / BLOCK
    }
}
