//! Where a point lies in a lattice, inside a kernel: the twin of `dvr_kernels::interpolate`.

#![allow(missing_docs)]

use cubecl::prelude::*;

/// A cell, and the position in it.
#[derive(CubeType)]
pub(super) struct Place {
    /// The cell's lowest node.
    pub node: u32,
    /// Position in the cell, each coordinate in `[0, 1]`.
    pub at: Array<f32>,
    /// How the position changes with the point along each axis: cells a unit of length, 0 outside the cube.
    pub scale: Array<f32>,
}

/// The place of `points[index]`, `[n, 3]`, in a lattice of `nodes` an edge over `[-half_extent, half_extent]^3`.
#[cube]
pub(super) fn place_of(points: &[f32], index: usize, nodes: u32, half_extent: f32) -> Place {
    let cells = f32::cast_from(nodes - 1u32);
    let per_cell = cells / (2.0f32 * half_extent);
    let mut at = Array::<f32>::new(3usize);
    let mut scale = Array::<f32>::new(3usize);
    let mut node = 0u32;
    let mut stride = 1u32;
    #[unroll]
    for axis in 0..3usize {
        let position = (points[index * 3 + axis] + half_extent) * per_cell;
        // What is not a number lies, like what is far below, in the first cell.
        let within = position >= 0.0f32 && position <= cells;
        let held = select(within, position, select(position > cells, cells, 0.0f32));
        let low = min(u32::cast_from(held), nodes - 2u32);
        at[axis] = held - f32::cast_from(low);
        scale[axis] = select(within, per_cell, 0.0f32);
        node += low * stride;
        stride *= nodes;
    }
    Place { node, at, scale }
}

#[cube]
impl Place {
    /// From the cell's lowest node to one of its corners, x fastest.
    pub fn corner(&self, #[comptime] corner: usize, nodes: u32) -> usize {
        let (x, y, z) = comptime!((corner as u32 & 1, corner as u32 >> 1 & 1, corner as u32 >> 2));
        (self.node + x + nodes * (y + nodes * z)) as usize
    }

    /// What a corner has of one axis: the position along it, or what is left of the cell.
    fn share(&self, #[comptime] corner: usize, #[comptime] axis: usize) -> f32 {
        if comptime!(corner >> axis & 1 == 1) { self.at[axis] } else { 1.0f32 - self.at[axis] }
    }

    /// What a corner adds to the value.
    pub fn weight(&self, #[comptime] corner: usize) -> f32 {
        self.share(corner, 0usize) * (self.share(corner, 1usize) * self.share(corner, 2usize))
    }

    /// The derivative of a corner's weight by the point along an axis.
    pub fn slope(&self, #[comptime] corner: usize, #[comptime] axis: usize) -> f32 {
        let (second, third) = comptime!(((axis + 1) % 3, (axis + 2) % 3));
        let across = self.share(corner, second) * self.share(corner, third) * self.scale[axis];
        if comptime!(corner >> axis & 1 == 1) { across } else { -across }
    }

    /// The derivative of a corner's weight by the point along two axes. Twice along one axis it is zero.
    pub fn second(&self, #[comptime] corner: usize, #[comptime] one: usize, #[comptime] other: usize) -> f32 {
        let rest = comptime!(3 - one - other);
        let across = self.share(corner, rest) * self.scale[one] * self.scale[other];
        if comptime!((corner >> one & 1) == (corner >> other & 1)) { across } else { -across }
    }
}
