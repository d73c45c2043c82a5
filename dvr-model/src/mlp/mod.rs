//! The decoder without gradients: a residual network of fully connected layers that never leaves the cache.
//!
//! A tile of points goes through all layers before the next one starts. Points lie along the lanes of vector registers,
//! so that no layer needs a sum over lanes, and each weight is read once for all points of a tile. The
//! instruction set (AVX2, AVX-512, NEON, plain) is chosen at run time.

mod dense;
mod features;
mod tile;

use std::fmt::Debug;
use std::sync::Arc;

use glam::Vec3;
use pulp::Arch;
use rayon::prelude::*;

use dense::Dense;
pub use dense::LinearWeights;
use features::{feature_count, write_features, write_tangents};
use tile::{Forward, Tile};

/// A residual network, packed for tiles.
///
/// `net = input(features(p))`; a block is `net + second(relu(first(relu(net))))`, before which a latent code may scale and
/// shift `net`; the values are `output(activation(net))`, where the last activation is a leaky ReLU. `features` are the
/// coordinates and, for `k < octaves`, `sin(2^k pi p)` and `cos(2^k pi p)`, and what else is known of a point.
#[derive(Clone, Debug)]
pub struct ResidualMlp {
    input: Dense,
    blocks: Vec<[Dense; 2]>,
    output: Dense,
    /// What is done before each block, where something is.
    modulations: Vec<Modulation>,
    octaves: usize,
    /// Inputs of the first layer behind those of the coordinates; 0 where there is none.
    further: Option<Arc<dyn PointFeatures>>,
    leak: f32,
}

/// What a point gives to the network beside its coordinates and their encoding.
pub trait PointFeatures: Debug + Send + Sync {
    /// How many numbers.
    fn count(&self) -> usize;

    /// Writes them for at most `width` points, `[count][width]`.
    fn write(&self, points: &[Vec3], width: usize, rows: &mut [f32]);

    /// Writes their derivatives along an axis.
    fn write_tangents(&self, points: &[Vec3], axis: usize, width: usize, rows: &mut [f32]);
}

/// `net = scale net + shift`, unit by unit.
#[derive(Clone, Debug)]
struct Modulation {
    scale: Vec<f32>,
    shift: Vec<f32>,
}

/// Panels that go through the layers together: enough to read each weight rarely, few enough for the cache.
const PANELS: usize = 2;

/// Panels of the forward-mode pass: the values, and their derivatives along the three axes.
const JACOBIAN_PANELS: usize = 4;

impl ResidualMlp {
    /// Packs the layers. `leak` is the slope of the last activation below zero.
    ///
    /// # Panics
    /// When the shapes of the layers do not fit each other.
    pub fn new(
        input: LinearWeights,
        blocks: &[[LinearWeights; 2]],
        output: LinearWeights,
        octaves: usize,
        leak: f32,
    ) -> Self {
        let hidden = input.outputs();
        assert!(input.inputs >= feature_count(octaves), "inputs of the first layer: {}", input.inputs);
        assert_eq!(output.inputs, hidden, "inputs of the last layer");
        for layer in blocks.iter().flatten() {
            assert_eq!((layer.inputs, layer.outputs()), (hidden, hidden), "a block's layer");
        }
        Self {
            input: Dense::new(input),
            blocks: blocks.iter().map(|block| block.map(Dense::new)).collect(),
            output: Dense::new(output),
            modulations: Vec::new(),
            octaves,
            further: None,
            leak,
        }
    }

    /// The network with these features behind those of the coordinates.
    ///
    /// # Panics
    /// When the first layer has not as many inputs.
    #[must_use]
    pub fn with_features(self, further: Arc<dyn PointFeatures>) -> Self {
        assert_eq!(self.input.inputs(), feature_count(self.octaves) + further.count(), "inputs of the first layer");
        Self { further: Some(further), ..self }
    }

    /// Features of at most `width` points for the first layer.
    fn write_features(&self, points: &[Vec3], width: usize, rows: &mut [f32]) {
        let (own, others) = rows.split_at_mut(feature_count(self.octaves) * width);
        write_features(points, self.octaves, width, own);
        if let Some(further) = &self.further {
            further.write(points, width, others);
        }
    }

    /// Their derivatives along an axis.
    fn write_tangents(&self, points: &[Vec3], axis: usize, width: usize, rows: &mut [f32]) {
        let (own, others) = rows.split_at_mut(feature_count(self.octaves) * width);
        write_tangents(points, axis, self.octaves, width, own);
        if let Some(further) = &self.further {
            further.write_tangents(points, axis, width, others);
        }
    }

    /// The network for one latent code: `conditions[i]`, one number per hidden unit, is added to `net` before block `i`; where
    /// there are twice as many, the second half, plus one, multiplies it first. The weights are shared, so that a network for
    /// each of many objects costs little.
    ///
    /// # Panics
    /// When there are more conditions than blocks, or they have another length than the hidden layers, or twice it.
    #[must_use]
    pub fn conditioned(&self, conditions: &[&[f32]]) -> Self {
        let (count, hidden) = (conditions.len(), self.input.outputs());
        assert!(count <= self.blocks.len(), "{count} conditions for {} blocks", self.blocks.len());
        let mut network = self.clone();
        for (i, condition) in conditions.iter().enumerate() {
            if condition.len() == 2 * hidden {
                let (shift, scale) = condition.split_at(hidden);
                let scale = scale.iter().map(|scale| 1.0 + scale).collect();
                network.modulations.push(Modulation { scale, shift: shift.to_vec() });
                continue;
            }
            // The sum before a block is what the layer before it leaves.
            let layer = if i == 0 { &mut network.input } else { &mut network.blocks[i - 1][1] };
            layer.shift(condition);
        }
        network
    }

    /// How many values a point has.
    pub fn outputs(&self) -> usize {
        self.output.outputs()
    }

    /// The first `channels` values at each point, side by side: `out` is `[points, channels]`.
    ///
    /// # Panics
    /// When `out` has another length, or there are fewer channels.
    pub fn evaluate(&self, points: &[Vec3], channels: usize, out: &mut [f32]) {
        assert!(channels <= self.outputs(), "{channels} of {} channels", self.outputs());
        assert_eq!(out.len(), points.len() * channels, "numbers to write");
        let width = panel_width();
        let tile_points = PANELS * width;
        out.par_chunks_mut(tile_points * channels).zip(points.par_chunks(tile_points)).for_each_init(
            || self.tile(PANELS),
            |tile, (out, points)| {
                for (panel, points) in points.chunks(width).enumerate() {
                    self.write_features(points, width, tile.features(panel));
                }
                self.forward(tile, false);
                for (i, values) in out.chunks_mut(channels).enumerate() {
                    let (panel, lane) = (i / width, i % width);
                    (0..channels).for_each(|c| values[c] = tile.output(panel)[c * width + lane]);
                }
            },
        );
    }

    /// The first value at each point, and its gradient, by forward-mode differentiation. ReLUs pass a derivative where
    /// their input is positive.
    pub fn value_and_gradient(&self, points: &[Vec3]) -> Vec<(f32, Vec3)> {
        let width = panel_width();
        let mut out = vec![(0.0, Vec3::ZERO); points.len()];
        out.par_chunks_mut(width).zip(points.par_chunks(width)).for_each_init(
            || self.tile(JACOBIAN_PANELS),
            |tile, (out, points)| {
                self.write_features(points, width, tile.features(0));
                for axis in 0..3 {
                    self.write_tangents(points, axis, width, tile.features(1 + axis));
                }
                self.forward(tile, true);
                for (i, (value, gradient)) in out.iter_mut().enumerate() {
                    *value = tile.output(0)[i];
                    *gradient = Vec3::from_array([1, 2, 3].map(|panel| tile.output(panel)[i]));
                }
            },
        );
        out
    }

    fn tile(&self, panels: usize) -> Tile {
        Tile::new(panels, panel_width(), self.input.inputs(), self.input.outputs(), self.output.padded_outputs())
    }

    /// All layers; with `tangents`, all panels but the first carry derivatives of the first.
    fn forward(&self, tile: &mut Tile, tangents: bool) {
        Arch::new().dispatch(Forward {
            input: &self.input,
            blocks: &self.blocks,
            output: &self.output,
            modulations: &self.modulations,
            leak: self.leak,
            tangents,
            tile,
        });
    }
}

/// Points per panel on this machine.
fn panel_width() -> usize {
    struct Lanes;
    impl pulp::WithSimd for Lanes {
        type Output = usize;
        fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }
    tile::VECTORS * Arch::new().dispatch(Lanes)
}

#[cfg(test)]
mod tests;
