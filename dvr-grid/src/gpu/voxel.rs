//! Points, and grids between whose nodes values are interpolated, inside a kernel: the counterpart of
//! `dvr_core::voxel::VoxelGrid`.

#![allow(missing_docs)]

use cubecl::prelude::*;

/// A point, a direction or a colour.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Point {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

#[cube]
impl Point {
    pub fn new(x: f32, y: f32, z: f32) -> Point {
        Point { x, y, z }
    }

    /// Three numbers side by side.
    pub fn read(numbers: &[f32], at: usize) -> Point {
        Point::new(numbers[at], numbers[at + 1], numbers[at + 2])
    }

    /// The same again: a kernel moves what it is given by value.
    pub fn copied(&self) -> Point {
        Point::new(self.x, self.y, self.z)
    }

    pub fn plus(&self, other: &Point) -> Point {
        Point::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }

    pub fn minus(&self, other: &Point) -> Point {
        Point::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }

    pub fn times(&self, factor: f32) -> Point {
        Point::new(self.x * factor, self.y * factor, self.z * factor)
    }

    pub fn over(&self, divisor: f32) -> Point {
        Point::new(self.x / divisor, self.y / divisor, self.z / divisor)
    }

    /// The point that a ray from here reaches.
    pub fn along(&self, direction: &Point, depth: f32) -> Point {
        self.plus(&direction.times(depth))
    }

    /// One of the coordinates.
    pub fn axis(&self, #[comptime] axis: usize) -> f32 {
        if comptime!(axis == 0) {
            self.x
        } else if comptime!(axis == 1) {
            self.y
        } else {
            self.z
        }
    }

    pub fn dot(&self, other: &Point) -> f32 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    pub fn length(&self) -> f32 {
        self.dot(self).sqrt()
    }

    pub fn sum(&self) -> f32 {
        self.x + self.y + self.z
    }

    /// Sum of absolute values.
    pub fn size(&self) -> f32 {
        self.x.abs() + self.y.abs() + self.z.abs()
    }

    /// Signs, 1 for zero.
    pub fn signs(&self) -> Point {
        Point::new(sign(self.x), sign(self.y), sign(self.z))
    }
}

#[cube]
fn sign(number: f32) -> f32 {
    select(number < 0.0f32, -1.0f32, 1.0f32)
}

#[cube]
pub(crate) fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

/// A position in cells, held in a grid of this many. What is not a number lies, like what is far below, in the first
/// cell.
#[cube]
pub(crate) fn held(position: f32, cells: f32) -> f32 {
    select(position >= 0.0f32 && position <= cells, position, select(position > cells, cells, 0.0f32))
}

/// From a cell's lowest node to one of its corners, x fastest, in a grid of this many nodes per edge.
#[cube]
pub(crate) fn corner_of(node: u32, #[comptime] corner: usize, nodes: u32) -> usize {
    let (x, y, z) = comptime!((corner as u32 & 1, corner as u32 >> 1 & 1, corner as u32 >> 2));
    (node + x + nodes * (y + nodes * z)) as usize
}

/// A grid over `[-half_extent, half_extent]^3`.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Grid {
    /// Nodes along an edge.
    pub nodes: u32,
    pub half_extent: f32,
    /// Distance between neighbouring nodes.
    pub spacing: f32,
}

/// A cell, and a position in it.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Cell {
    /// Its lowest node.
    pub node: u32,
    /// Each coordinate in `[0, 1]`.
    pub at: Point,
}

/// An interpolated value and its gradient in space.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Slope {
    pub value: f32,
    pub gradient: Point,
}

#[cube]
pub(crate) fn grid(nodes: u32, half_extent: f32) -> Grid {
    Grid { nodes, half_extent, spacing: 2.0f32 * half_extent / f32::cast_from(nodes - 1u32) }
}

#[cube]
impl Grid {
    /// A coordinate in cells from the lowest corner.
    pub fn in_cells(&self, coordinate: f32) -> f32 {
        (coordinate + self.half_extent) / self.spacing
    }

    /// The cell that a point lies in; points outside belong to the nearest point of the cube.
    pub fn locate(&self, point: &Point) -> Cell {
        let cells = self.nodes - 1u32;
        let most = f32::cast_from(cells);
        let x = held(self.in_cells(point.x), most);
        let y = held(self.in_cells(point.y), most);
        let z = held(self.in_cells(point.z), most);
        let low_x = min(u32::cast_from(x), cells - 1u32);
        let low_y = min(u32::cast_from(y), cells - 1u32);
        let low_z = min(u32::cast_from(z), cells - 1u32);
        let at = Point::new(x - f32::cast_from(low_x), y - f32::cast_from(low_y), z - f32::cast_from(low_z));
        Cell { node: (low_z * self.nodes + low_y) * self.nodes + low_x, at }
    }

    /// A corner of a cell, x fastest.
    pub fn corner(&self, node: u32, #[comptime] corner: usize) -> usize {
        corner_of(node, corner, self.nodes)
    }

    /// The interpolated value at a point, and its gradient.
    pub fn slope(&self, values: &[f32], point: &Point) -> Slope {
        let cell = self.locate(point);
        let mut dx = Array::<f32>::new(4usize);
        let mut vx = Array::<f32>::new(4usize);
        #[unroll]
        for i in 0..4usize {
            let low = values[self.corner(cell.node, comptime!(2 * i))];
            dx[i] = values[self.corner(cell.node, comptime!(2 * i + 1))] - low;
            vx[i] = low + dx[i] * cell.at.x;
        }
        let low = lerp(vx[0], vx[1], cell.at.y);
        let high = lerp(vx[2], vx[3], cell.at.y);
        let gradient = Point::new(
            lerp(lerp(dx[0], dx[1], cell.at.y), lerp(dx[2], dx[3], cell.at.y), cell.at.z),
            lerp(vx[1] - vx[0], vx[3] - vx[2], cell.at.z),
            high - low,
        );
        Slope { value: lerp(low, high, cell.at.z), gradient: gradient.over(self.spacing) }
    }
}

#[cube]
impl Cell {
    /// What a corner has of an axis: the position along it, or what is left of the cell.
    pub fn share(&self, #[comptime] corner: usize, #[comptime] axis: usize) -> f32 {
        let at = self.at.axis(axis);
        if comptime!(corner >> axis & 1 == 1) { at } else { 1.0f32 - at }
    }

    /// What a corner adds to the value.
    pub fn weight(&self, #[comptime] corner: usize) -> f32 {
        self.share(corner, 0usize) * (self.share(corner, 1usize) * self.share(corner, 2usize))
    }

    /// What a corner adds to the derivative along a direction, per cell.
    pub fn gradient_weight(&self, #[comptime] corner: usize, direction: &Point) -> f32 {
        let (x, y, z) = (self.share(corner, 0usize), self.share(corner, 1usize), self.share(corner, 2usize));
        let dx = if comptime!(corner & 1 == 1) { direction.x } else { -direction.x };
        let dy = if comptime!(corner >> 1 & 1 == 1) { direction.y } else { -direction.y };
        let dz = if comptime!(corner >> 2 == 1) { direction.z } else { -direction.z };
        dx * y * z + x * dy * z + x * y * dz
    }
}
