//! Where a point lies in a lattice, inside a kernel, with what differentiation asks of it: the twin of
//! `dvr_kernels::interpolate`.

#![allow(missing_docs)]

use cubecl::prelude::*;

use crate::space::{Cell, Point, corner_of, held};

/// A cell and the position in it, and how that changes with the point.
#[derive(CubeType)]
pub(super) struct Place {
    cell: Cell,
    /// How the position changes with the point along each axis: cells a unit of length, 0 outside the cube.
    pub scale: Point,
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
        let within = held(position, cells);
        let low = min(u32::cast_from(within), nodes - 2u32);
        at[axis] = within - f32::cast_from(low);
        scale[axis] = select(position >= 0.0f32 && position <= cells, per_cell, 0.0f32);
        node += low * stride;
        stride *= nodes;
    }
    let cell = Cell { node, at: Point::new(at[0], at[1], at[2]) };
    Place { cell, scale: Point::new(scale[0], scale[1], scale[2]) }
}

#[cube]
impl Place {
    /// From the cell's lowest node to one of its corners, x fastest.
    pub fn corner(&self, #[comptime] corner: usize, nodes: u32) -> usize {
        corner_of(self.cell.node, corner, nodes)
    }

    /// What a corner adds to the value.
    pub fn weight(&self, #[comptime] corner: usize) -> f32 {
        self.cell.weight(corner)
    }

    /// The derivative of a corner's weight by the point along an axis.
    pub fn slope(&self, #[comptime] corner: usize, #[comptime] axis: usize) -> f32 {
        let (second, third) = comptime!(((axis + 1) % 3, (axis + 2) % 3));
        let across = self.cell.share(corner, second) * self.cell.share(corner, third) * self.scale.axis(axis);
        if comptime!(corner >> axis & 1 == 1) { across } else { -across }
    }

    /// The derivative of a corner's weight by the point along two axes. Twice along one axis it is zero.
    pub fn second(&self, #[comptime] corner: usize, #[comptime] one: usize, #[comptime] other: usize) -> f32 {
        let rest = comptime!(3 - one - other);
        let across = self.cell.share(corner, rest) * self.scale.axis(one) * self.scale.axis(other);
        if comptime!((corner >> one & 1) == (corner >> other & 1)) { across } else { -across }
    }
}
