//! The residual decoder inside a kernel: all units of a group push a tile of points through its layers together.
//!
//! A unit owns some columns of each layer, and keeps what they have become in registers; the group's shared memory
//! holds what all units must see: the layer's inputs. Each weight is read once per tile, and serves all its points.

// What `#[cube]` generates beside each function has no documentation.
#![allow(missing_docs)]

use cubecl::prelude::*;

use super::plan::{Condition, DecoderShape};

/// Numbers per ray in the kernels' table of rays: origin, direction, entry, exit, jitter, object.
pub(super) const RAY_COLUMNS: usize = 10;

/// Numbers of four points side by side: one instruction reads them from shared memory, where one per number would be the
/// bottleneck.
pub(super) type Quad = Vector<f32, Const<4>>;

/// What a group of units shares while it evaluates a tile of points.
#[derive(CubeType)]
pub(super) struct Tile {
    /// The points, `[3][slots]`.
    pub points: Shared<[f32]>,
    /// The object of each point, `[slots]`.
    pub objects: Shared<[u32]>,
    /// The inputs of the layer in work, `[inputs][slots / 4]`.
    pub inputs: Shared<[Quad]>,
    /// The answer: occupancy logits, `[slots]`.
    pub logits: Shared<[f32]>,
}

#[cube]
impl Tile {
    /// Room for one tile. To be called once per kernel, by all units.
    pub fn new(#[comptime] shape: DecoderShape) -> Tile {
        Tile {
            points: Shared::new_slice(comptime!(3 * shape.slots)),
            objects: Shared::new_slice(comptime!(shape.slots)),
            inputs: Shared::new_slice(comptime!(shape.widest() * shape.quads())),
            logits: Shared::new_slice(comptime!(shape.slots)),
        }
    }
}

/// Occupancy logits of the tile's points; `leak` is the slope of the last activation for negative values.
///
/// All units call it together; each finds all logits when it returns.
#[cube]
pub(super) fn evaluate(
    tile: &mut Tile,
    weights: &[f32],
    conditions: &[f32],
    objects: u32,
    leak: f32,
    #[comptime] shape: DecoderShape,
) {
    let quads = comptime!(shape.quads());
    let hidden = comptime!(shape.hidden);
    let own = comptime!(shape.columns() * quads);
    encode(tile, shape);
    sync_cube();
    let mut net = Array::<Quad>::new(own);
    let mut inner = Array::<Quad>::new(own);
    linear(&tile.inputs, weights, 0usize, &mut net, comptime!(shape.features()), shape);
    sync_cube();

    let first_block = comptime!((shape.features() + 1) * hidden);
    let layer = comptime!((hidden + 1) * hidden);
    for block in 0..comptime!(shape.blocks) {
        if comptime!(shape.condition != Condition::None) {
            condition(tile, conditions, block * objects as usize, &mut net, shape);
        }
        rectify(&net, &mut tile.inputs, 0.0f32, shape);
        sync_cube();
        let at = first_block + 2 * block * layer;
        linear(&tile.inputs, weights, at, &mut inner, hidden, shape);
        sync_cube();
        rectify(&inner, &mut tile.inputs, 0.0f32, shape);
        sync_cube();
        linear(&tile.inputs, weights, at + layer, &mut inner, hidden, shape);
        sync_cube();
        #[unroll]
        for i in 0..own {
            net[i] += inner[i];
        }
    }
    rectify(&net, &mut tile.inputs, leak, shape);
    sync_cube();

    // The output layer has one column here: a unit for each four points adds it up.
    let quad = UNIT_POS as usize;
    if quad < quads {
        let at = first_block + 2 * comptime!(shape.blocks) * layer;
        let mut logits = Quad::new(weights[at + hidden]);
        for k in 0..hidden {
            logits += tile.inputs[k * quads + quad] * Quad::new(weights[at + k]);
        }
        #[unroll]
        for lane in 0..4usize {
            tile.logits[4 * quad + lane] = logits.extract(lane);
        }
    }
    sync_cube();
}

/// `[p, sin(2^k pi p), cos(2^k pi p)]` of each point, into the tile's inputs.
#[cube]
fn encode(tile: &mut Tile, #[comptime] shape: DecoderShape) {
    let quads = comptime!(shape.quads());
    let count = comptime!(shape.features() * quads);
    let mut i = UNIT_POS as usize;
    while i < count {
        let feature = i / quads;
        let quad = i % quads;
        let mut values = Quad::zeroed();
        #[unroll]
        for lane in 0..4usize {
            let coordinate = tile.points[feature % 3 * comptime!(shape.slots) + 4 * quad + lane];
            let mut value = coordinate;
            if feature >= 3 {
                let wave = feature / 3 - 1;
                let phase = coordinate * (std::f32::consts::PI * f32::cast_from(1u32 << (wave as u32 / 2u32)));
                value = if (wave & 1) == 0 { phase.sin() } else { phase.cos() };
            }
            values.insert(lane, value);
        }
        tile.inputs[i] = values;
        i += CUBE_DIM as usize;
    }
}

/// A layer: `outputs = inputs W + b` for the unit's columns, with `W [count, hidden]` and `b [hidden]` after it, from
/// `at` on.
#[cube]
fn linear(
    inputs: &Shared<[Quad]>,
    weights: &[f32],
    at: usize,
    outputs: &mut Array<Quad>,
    #[comptime] count: usize,
    #[comptime] shape: DecoderShape,
) {
    let quads = comptime!(shape.quads());
    let hidden = comptime!(shape.hidden);
    #[unroll]
    for c in 0..comptime!(shape.columns()) {
        let column = UNIT_POS as usize + c * comptime!(shape.units);
        if column < hidden {
            let bias = Quad::new(weights[at + count * hidden + column]);
            #[unroll]
            for q in 0..quads {
                outputs[c * quads + q] = bias;
            }
            for k in 0..count {
                let weight = Quad::new(weights[at + k * hidden + column]);
                #[unroll]
                for q in 0..quads {
                    outputs[c * quads + q] += weight * inputs[k * quads + q];
                }
            }
        }
    }
}

/// The unit's columns after a (leaky) ReLU, for all units to see.
#[cube]
fn rectify(values: &Array<Quad>, inputs: &mut Shared<[Quad]>, leak: f32, #[comptime] shape: DecoderShape) {
    let quads = comptime!(shape.quads());
    #[unroll]
    for c in 0..comptime!(shape.columns()) {
        let column = UNIT_POS as usize + c * comptime!(shape.units);
        if column < comptime!(shape.hidden) {
            #[unroll]
            for q in 0..quads {
                let before = values[c * quads + q];
                let mut after = Quad::zeroed();
                #[unroll]
                for lane in 0..4usize {
                    let value = before.extract(lane);
                    after.insert(lane, select(value > 0.0f32, value, value * leak));
                }
                inputs[column * quads + q] = after;
            }
        }
    }
}

/// Puts the layer before a block under the condition of each point's code: row `first + object` of `conditions`, whose first
/// `hidden` numbers are added; further ones, plus one, multiply first.
#[cube]
fn condition(
    tile: &mut Tile,
    conditions: &[f32],
    first: usize,
    net: &mut Array<Quad>,
    #[comptime] shape: DecoderShape,
) {
    let quads = comptime!(shape.quads());
    let hidden = comptime!(shape.hidden);
    #[unroll]
    for c in 0..comptime!(shape.columns()) {
        let column = UNIT_POS as usize + c * comptime!(shape.units);
        if column < hidden {
            #[unroll]
            for q in 0..quads {
                let mut shift = Quad::zeroed();
                let mut scale = Quad::new(1.0f32);
                #[unroll]
                for lane in 0..4usize {
                    let row = first + tile.objects[4 * q + lane] as usize;
                    if comptime!(shape.condition == Condition::ShiftAndScale) {
                        shift.insert(lane, conditions[2 * row * hidden + column]);
                        scale.insert(lane, 1.0f32 + conditions[(2 * row + 1) * hidden + column]);
                    } else {
                        shift.insert(lane, conditions[row * hidden + column]);
                    }
                }
                net[c * quads + q] = net[c * quads + q] * scale + shift;
            }
        }
    }
}
