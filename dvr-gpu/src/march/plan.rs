//! What a kernel is compiled for: the network's shape, and how a group of units shares the work.

/// A residual decoder, and how many units and points evaluate it together. Kernels are compiled for each shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct DecoderShape {
    /// Width of the hidden layers.
    pub hidden: usize,
    /// Residual blocks.
    pub blocks: usize,
    /// Octaves of the encoding of points.
    pub octaves: usize,
    /// What the layer before a block is given of its object's code.
    pub condition: Condition,
    /// Units of a group.
    pub units: usize,
    /// Points that a group evaluates at once, one of each ray that it has in flight; a multiple of four.
    pub slots: usize,
}

/// What a layer is given of a code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Condition {
    /// Nothing.
    None,
    /// A number for each unit, which is added.
    Shift,
    /// And another one, which, plus one, multiplies the unit first.
    ShiftAndScale,
}

impl DecoderShape {
    /// Inputs of the network: coordinates, sines and cosines.
    pub fn features(&self) -> usize {
        3 + 6 * self.octaves
    }

    /// Inputs of its widest layer.
    pub fn widest(&self) -> usize {
        self.features().max(self.hidden)
    }

    /// Fours of points that a group evaluates at once.
    pub fn quads(&self) -> usize {
        self.slots / 4
    }

    /// Columns of a layer that a unit computes.
    pub fn columns(&self) -> usize {
        self.hidden.div_ceil(self.units)
    }

    /// Memory that a group shares, in bytes: the tile (points, objects, inputs, logits) and its counters.
    pub fn shared_bytes(&self) -> usize {
        4 * (self.slots * (3 + 1 + self.widest() + 1 + 1) + 1)
    }

    /// Numbers in its packed weights: all layers but the colour's part of the last.
    pub fn weights(&self) -> usize {
        (self.features() + 1) * self.hidden + 2 * self.blocks * (self.hidden + 1) * self.hidden + self.hidden + 1
    }
}

/// How rays are searched. Kernels are compiled for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Search {
    /// How a bracketed crossing is located.
    pub root: Root,
    /// Evaluations that this takes.
    pub root_steps: u32,
    /// Whether samples are shifted by a jitter a ray.
    pub jittered: bool,
}

/// How the crossing in a bracket is located.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Root {
    /// False position.
    Secant,
    /// Halving.
    Bisection,
    /// Chandrupatla's method.
    Chandrupatla,
}
