//! How colour follows from the numbers at the nodes of the colour grid: the one place that knows.
//!
//! A node has [`CHANNELS`] numbers, interpolated between nodes. The colour of a point is linear in them, and may depend
//! on the direction that it is seen from. At present a node holds sRGB, the same from everywhere. For colour that
//! depends on the direction, a node would hold coefficients (of spherical harmonics, say), and the functions of this
//! file would weigh them.

use dvr_core::voxel::Cell;
use glam::Vec3;

use crate::bricks::BrickValues;

/// Numbers per node.
pub(crate) const CHANNELS: usize = 3;

/// A colour, and its derivative by the ray depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ColorSample {
    pub color: Vec3,
    pub derivative: Vec3,
}

/// The numbers of a node that shows one colour in all directions.
pub(crate) fn constant(color: [f32; 3]) -> [f32; CHANNELS] {
    color
}

/// The colour that interpolated numbers make for a viewer who looks along `_viewing`, of unit length; `None` for no
/// direction in particular.
pub(crate) fn evaluate(channels: [f32; CHANNELS], _viewing: Option<Vec3>) -> Vec3 {
    Vec3::from(channels)
}

/// The gradient by the interpolated numbers, given that by the colour.
pub(crate) fn channel_gradient(grad_color: Vec3, _viewing: Option<Vec3>) -> [f32; CHANNELS] {
    grad_color.to_array()
}

/// Colour in a cell, and its derivative along `step` in space, seen along `viewing`.
pub(crate) fn sample(values: &BrickValues<CHANNELS>, cell: &Cell, step: Vec3, viewing: Option<Vec3>) -> ColorSample {
    let grid = values.grid();
    let slopes = cell.gradient_weights(step / grid.spacing());
    let (mut value, mut derivative) = ([0.0; CHANNELS], [0.0; CHANNELS]);
    let corners = values.corners(grid.coordinates(cell.node));
    for ((weight, slope), node) in cell.weights().into_iter().zip(slopes).zip(&corners) {
        for (c, number) in node.iter().enumerate() {
            value[c] += weight * number;
            derivative[c] += slope * number;
        }
    }
    ColorSample { color: evaluate(value, viewing), derivative: evaluate(derivative, viewing) }
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::CHANNELS;
    use crate::gpu::voxel::{Grid, Point};

    /// A colour, and its derivative by the ray depth.
    #[derive(CubeType)]
    pub(crate) struct ColorSample {
        pub color: Point,
        pub derivative: Point,
    }

    /// The numbers of a node.
    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Channels {
        pub red: f32,
        pub green: f32,
        pub blue: f32,
    }

    #[cube]
    impl Channels {
        /// One of the numbers.
        pub fn at(&self, #[comptime] channel: usize) -> f32 {
            if comptime!(channel == 0) {
                self.red
            } else if comptime!(channel == 1) {
                self.green
            } else {
                self.blue
            }
        }
    }

    impl ChannelsLaunch {
        pub fn of([red, green, blue]: [f32; CHANNELS]) -> Self {
            Self { red, green, blue }
        }
    }

    /// Colour at a point, and its derivative along `direction`, seen along the same direction; zero for no direction in
    /// particular.
    #[cube]
    pub(crate) fn sample(colors: &[f32], grid: &Grid, point: &Point, direction: &Point) -> ColorSample {
        let cell = grid.locate(point);
        let in_cells = direction.over(grid.spacing);
        let mut red = 0.0f32;
        let mut green = 0.0f32;
        let mut blue = 0.0f32;
        let mut along_red = 0.0f32;
        let mut along_green = 0.0f32;
        let mut along_blue = 0.0f32;
        #[unroll]
        for corner in 0..8usize {
            let node = grid.corner(cell.node, corner) * CHANNELS;
            let (weight, slope) = (cell.weight(corner), cell.gradient_weight(corner, &in_cells));
            red += weight * colors[node];
            green += weight * colors[node + 1];
            blue += weight * colors[node + 2];
            along_red += slope * colors[node];
            along_green += slope * colors[node + 1];
            along_blue += slope * colors[node + 2];
        }
        ColorSample { color: Point::new(red, green, blue), derivative: Point::new(along_red, along_green, along_blue) }
    }

    /// The gradient by the interpolated numbers, given that by the colour: written to `row` from `at` on.
    #[cube]
    pub(crate) fn write_channel_gradient(grad_color: &Point, _viewing: &Point, row: &mut [f32], at: usize) {
        row[at] = grad_color.x;
        row[at + 1] = grad_color.y;
        row[at + 2] = grad_color.z;
    }
}
