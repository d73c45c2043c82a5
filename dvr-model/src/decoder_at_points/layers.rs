//! Where a decoder's numbers lie among the inputs.

use std::ops::Range;

use super::OUTPUTS;

/// The sizes of a decoder, and where its numbers lie among the inputs: first layer, blocks and last layer, each a weight
/// `[inputs, outputs]` and a bias; what codes make of the layer before each block; features of the points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layers {
    pub points: usize,
    /// Numbers that a point gives to the first layer.
    pub features: usize,
    pub hidden: usize,
    pub blocks: usize,
    /// Blocks with a condition before them: none or all.
    pub conditions: usize,
    pub objects: usize,
    /// Numbers of a condition: `hidden` that shift, or as many again that scale, after them.
    pub given: usize,
    /// Slope of the last activation below zero.
    pub leak: f32,
}

/// A linear layer among the inputs.
pub(super) struct Linear {
    pub weight: Range<usize>,
    pub bias: Range<usize>,
}

impl Layers {
    fn linear(at: usize, inputs: usize, outputs: usize) -> Linear {
        let weight = at..at + inputs * outputs;
        Linear { bias: weight.end..weight.end + outputs, weight }
    }

    pub fn input(&self) -> Linear {
        Self::linear(0, self.features, self.hidden)
    }

    /// The layers of a block.
    pub fn block(&self, i: usize) -> [Linear; 2] {
        let size = (self.hidden + 1) * self.hidden;
        [2 * i, 2 * i + 1].map(|layer| Self::linear(self.input().bias.end + layer * size, self.hidden, self.hidden))
    }

    pub fn output(&self) -> Linear {
        let size = (self.hidden + 1) * self.hidden;
        Self::linear(self.input().bias.end + 2 * self.blocks * size, self.hidden, OUTPUTS)
    }

    /// What is given to an object before a block.
    pub fn condition(&self, block: usize, object: usize) -> Range<usize> {
        let first = self.output().bias.end + (block * self.objects + object) * self.given;
        first..first + self.given
    }

    /// All that is the same for all points.
    pub fn parameters(&self) -> Range<usize> {
        0..self.output().bias.end + self.conditions * self.objects * self.given
    }

    pub fn scales(&self) -> bool {
        self.given == 2 * self.hidden
    }
}
