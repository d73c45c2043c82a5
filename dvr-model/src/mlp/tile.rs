//! A tile of points on its way through the layers.

use pulp::{Simd, WithSimd};

use super::Modulation;
use super::dense::{BLOCK, Dense};

/// Vector registers along a row of a panel: three, with four or eight rows, fill the 16 or 32 registers of a core.
pub(super) const VECTORS: usize = 3;

/// Floats to the cache line: vectors that straddle lines cost two reads.
const LINE: usize = 16;

/// What the points of a tile are at the layers, panel by panel, row by row: a row holds one unit of all points of a
/// panel.
pub(super) struct Tile {
    panels: usize,
    features: Rows,
    /// The residual stream.
    net: Rows,
    /// What comes out of an activation.
    active: Rows,
    /// What goes into the activation within a block.
    inner: Rows,
    output: Rows,
}

impl Tile {
    /// A tile of `panels` panels of `width` points for a network of the given numbers of units.
    pub(super) fn new(panels: usize, width: usize, features: usize, hidden: usize, outputs: usize) -> Self {
        let rows = |units: usize| Rows::new(panels, units.next_multiple_of(BLOCK) * width);
        Self {
            panels,
            features: Rows::new(panels, features * width),
            net: rows(hidden),
            active: rows(hidden),
            inner: rows(hidden),
            output: rows(outputs),
        }
    }

    /// Where the features of a panel are to be written, `[features][width]`.
    pub(super) fn features(&mut self, panel: usize) -> &mut [f32] {
        self.features.panel_mut(panel)
    }

    /// The values of a panel, `[outputs][width]`.
    pub(super) fn output(&self, panel: usize) -> &[f32] {
        self.output.panel(panel)
    }
}

/// Rows of all panels, on cache lines.
struct Rows {
    values: Vec<f32>,
    offset: usize,
    panel: usize,
}

impl Rows {
    /// `panels` panels, each with its numbers.
    fn new(panels: usize, panel: usize) -> Self {
        let values = vec![0.0; panels * panel + LINE];
        let offset = values.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE);
        Self { values, offset, panel }
    }

    fn panel(&self, i: usize) -> &[f32] {
        &self.values[self.offset + i * self.panel..][..self.panel]
    }

    fn panel_mut(&mut self, i: usize) -> &mut [f32] {
        &mut self.values[self.offset + i * self.panel..][..self.panel]
    }
}

/// One pass of a tile through a network.
pub(super) struct Forward<'a> {
    pub input: &'a Dense,
    pub blocks: &'a [[Dense; 2]],
    pub output: &'a Dense,
    /// One before each block, or none.
    pub modulations: &'a [Modulation],
    /// Slope of the last activation below zero.
    pub leak: f32,
    /// Whether the panels after the first hold derivatives of the first.
    pub tangents: bool,
    pub tile: &'a mut Tile,
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Twelve sums, or twenty-four.
        if S::REGISTER_COUNT >= 32 { self.run::<S, 8>(simd) } else { self.run::<S, 4>(simd) }
    }
}

impl Forward<'_> {
    #[inline(always)]
    fn run<S: Simd, const ROWS: usize>(self, simd: S) {
        let Self { input, blocks, output, modulations, leak, tangents, tile } = self;
        let Tile { panels, features, net, active, inner, output: out } = tile;
        let layer = Layer { simd, panels: *panels, tangents };
        layer.multiply::<ROWS>(input, features, net, false);
        for (i, [first, second]) in blocks.iter().enumerate() {
            if let Some(modulation) = modulations.get(i) {
                layer.modulate(modulation, net);
            }
            layer.activate(net, active, 0.0);
            layer.multiply::<ROWS>(first, active, inner, false);
            layer.activate(inner, active, 0.0);
            layer.multiply::<ROWS>(second, active, net, true);
        }
        layer.activate(net, active, leak);
        layer.multiply::<ROWS>(output, active, out, false);
    }
}

/// What the steps of a pass have in common.
#[derive(Clone, Copy)]
struct Layer<S> {
    simd: S,
    panels: usize,
    tangents: bool,
}

impl<S: Simd> Layer<S> {
    /// `target = W source + b`, or `target += W source + b`; derivatives have no bias.
    #[inline(always)]
    fn multiply<const ROWS: usize>(self, dense: &Dense, source: &Rows, target: &mut Rows, add: bool) {
        let row = VECTORS * S::F32_LANES;
        for block in 0..dense.blocks() {
            let (weights, bias) = dense.block(block);
            for panel in 0..self.panels {
                let (source, _) = S::as_simd_f32s(source.panel(panel));
                let target = &mut target.panel_mut(panel)[block * BLOCK * row..(block + 1) * BLOCK * row];
                let (target, _) = S::as_mut_simd_f32s(target);
                for (part, target) in target.chunks_exact_mut(ROWS * VECTORS).enumerate() {
                    let first = part * ROWS;
                    let biased = panel == 0 || !self.tangents;
                    let bias = std::array::from_fn(|i| if biased { bias[first + i] } else { 0.0 });
                    let sums = self.product::<ROWS>(weights, first, source, bias);
                    for (sums, target) in sums.into_iter().zip(target.chunks_exact_mut(VECTORS)) {
                        for (sum, target) in sums.into_iter().zip(target) {
                            *target = if add { self.simd.add_f32s(*target, sum) } else { sum };
                        }
                    }
                }
            }
        }
    }

    /// Some rows of a product: outputs `first..first + ROWS` of a block for all points of a panel.
    #[inline(always)]
    fn product<const ROWS: usize>(
        self,
        weights: &[[f32; BLOCK]],
        first: usize,
        source: &[S::f32s],
        bias: [f32; ROWS],
    ) -> [[S::f32s; VECTORS]; ROWS] {
        let mut sums = bias.map(|bias| [self.simd.splat_f32s(bias); VECTORS]);
        for (weights, source) in weights.iter().zip(source.chunks_exact(VECTORS)) {
            for (i, sums) in sums.iter_mut().enumerate() {
                let weight = self.simd.splat_f32s(weights[(first + i) % BLOCK]);
                for (sum, source) in sums.iter_mut().zip(source) {
                    *sum = self.simd.mul_add_e_f32s(weight, *source, *sum);
                }
            }
        }
        sums
    }

    /// `net = scale net + shift`; derivatives are scaled alone.
    #[inline(always)]
    fn modulate(self, modulation: &Modulation, net: &mut Rows) {
        for panel in 0..self.panels {
            let shifted = panel == 0 || !self.tangents;
            let (net, _) = S::as_mut_simd_f32s(net.panel_mut(panel));
            let units = modulation.scale.iter().zip(&modulation.shift);
            for ((scale, shift), net) in units.zip(net.chunks_exact_mut(VECTORS)) {
                let scale = self.simd.splat_f32s(*scale);
                let shift = self.simd.splat_f32s(if shifted { *shift } else { 0.0 });
                net.iter_mut().for_each(|net| *net = self.simd.mul_add_e_f32s(*net, scale, shift));
            }
        }
    }

    /// `target = max(source, leak source)`; derivatives pass where the value is positive.
    #[inline(always)]
    fn activate(self, source: &Rows, target: &mut Rows, leak: f32) {
        let zero = self.simd.splat_f32s(0.0);
        let leak = self.simd.splat_f32s(leak);
        for panel in 0..self.panels {
            let deciding = if self.tangents { 0 } else { panel };
            let (deciding, _) = S::as_simd_f32s(source.panel(deciding));
            let (source, _) = S::as_simd_f32s(source.panel(panel));
            let (target, _) = S::as_mut_simd_f32s(target.panel_mut(panel));
            for ((deciding, source), target) in deciding.iter().zip(source).zip(target) {
                let positive = self.simd.greater_than_f32s(*deciding, zero);
                *target = self.simd.select_f32s(positive, *source, self.simd.mul_f32s(*source, leak));
            }
        }
    }
}
