//! The cells that a ray passes through, and where it first meets the surface, inside a kernel: the counterpart
//! of `crate::occupancy` and of `dvr_core::voxel::VoxelTraversal`.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::cubic::{Cubic, NOWHERE};
use super::occupancy::words;
use super::voxel::{Grid, Point, grid};
use crate::active::ActiveNodes;

/// Farther than anything.
pub(crate) const FAR: f32 = 3.0e38;

/// The shape's grid, and the box of cells that the surface may be in: from `low` up to but without `high`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct Region {
    pub nodes: u32,
    pub half_extent: f32,
    pub low_x: u32,
    pub low_y: u32,
    pub low_z: u32,
    pub high_x: u32,
    pub high_y: u32,
    pub high_z: u32,
}

impl RegionLaunch {
    /// The cells `low..high` of a grid.
    pub fn of(nodes: u32, half_extent: f32, [low, high]: [[u32; 3]; 2]) -> Self {
        let [low_x, low_y, low_z] = low;
        let [high_x, high_y, high_z] = high;
        Self { nodes, half_extent, low_x, low_y, low_z, high_x, high_y, high_z }
    }
}

/// The smallest box of cells that holds all that can ever be inside: the cells that are marked now, from the first up to
/// but without the second corner of `marked`, and those on either side of nodes that may change.
pub(crate) fn region(marked: [[usize; 3]; 2], active: &ActiveNodes) -> [[u32; 3]; 2] {
    let (mut low, mut high) = (marked[0], marked[1]);
    if high == [0; 3] {
        low = [usize::MAX; 3];
    }
    let grid = active.grid();
    for &(start, length) in (0..grid.nodes()).flat_map(|z| active.layer(z)) {
        let [x, y, z] = grid.coordinates(start as usize);
        for (axis, [first, last]) in [[x, x + length as usize - 1], [y, y], [z, z]].into_iter().enumerate() {
            low[axis] = low[axis].min(first.saturating_sub(1));
            high[axis] = high[axis].max((last + 1).min(grid.cells()));
        }
    }
    if high == [0; 3] { [[0; 3]; 2] } else { [low, high].map(|corner| corner.map(|at| at as u32)) }
}

#[cube]
impl Region {
    pub fn grid(&self) -> Grid {
        grid(self.nodes, self.half_extent)
    }
}

/// A ray on its way through the cells of a region (Amanatides and Woo 1987), front to back.
#[derive(CubeType)]
pub(crate) struct VoxelTraversal {
    x: RuntimeCell<u32>,
    y: RuntimeCell<u32>,
    z: RuntimeCell<u32>,
    /// Ray depth at which the next plane of each axis is crossed.
    next_x: RuntimeCell<f32>,
    next_y: RuntimeCell<f32>,
    next_z: RuntimeCell<f32>,
    /// Between two planes.
    delta: Point,
    /// The directions of the axes, as their signs.
    direction: Point,
    /// Ray depth at which the present cell was entered.
    depth: RuntimeCell<f32>,
    end: f32,
    going: RuntimeCell<u32>,
}

/// The ray depths between which a ray lies between two planes of an axis; the second is smaller where it never does.
#[cube]
fn between(origin: f32, direction: f32, low: f32, high: f32) -> Interval {
    let mut enter = -f32::new(FAR);
    let mut leave = f32::new(FAR);
    if direction == 0.0f32 {
        if origin < low || origin > high {
            leave = -f32::new(FAR);
        }
    } else {
        let inverse = 1.0f32 / direction;
        let a = (low - origin) * inverse;
        let b = (high - origin) * inverse;
        enter = a.min(b);
        leave = a.max(b);
    }
    Interval { enter, leave }
}

#[derive(CubeType, Clone, Copy)]
struct Interval {
    enter: f32,
    leave: f32,
}

/// The cell along an axis in which a ray enters, within a box.
#[cube]
fn first_cell(position: f32, low: u32, high: u32) -> u32 {
    // Before the conversion, which knows no negative numbers.
    u32::cast_from(position.max(f32::cast_from(low)).min(f32::cast_from(high - 1u32)))
}

/// Ray depth at which a ray that is in a cell crosses the cell's farther plane of an axis.
#[cube]
fn next_plane(grid: &Grid, cell: u32, origin: f32, direction: f32) -> f32 {
    let mut depth = f32::new(FAR);
    if direction != 0.0f32 {
        let plane = f32::cast_from(cell + select(direction > 0.0f32, 1u32, 0u32)) * grid.spacing - grid.half_extent;
        depth = (plane - origin) * (1.0f32 / direction);
    }
    depth
}

/// Depth between two planes of an axis.
#[cube]
fn spacing_along(grid: &Grid, direction: f32) -> f32 {
    let mut depth = f32::new(FAR);
    if direction != 0.0f32 {
        depth = (grid.spacing / direction).abs();
    }
    depth
}

/// Begins a walk between two ray depths. Where the ray misses the region it is over at once.
#[cube]
pub(crate) fn walk(region: &Region, origin: &Point, direction: &Point, from: f32, to: f32) -> VoxelTraversal {
    let grid = region.grid();
    let x = between(origin.x, direction.x, plane(&grid, region.low_x), plane(&grid, region.high_x));
    let y = between(origin.y, direction.y, plane(&grid, region.low_y), plane(&grid, region.high_y));
    let z = between(origin.z, direction.z, plane(&grid, region.low_z), plane(&grid, region.high_z));
    let enter = from.max(x.enter).max(y.enter).max(z.enter);
    let leave = to.min(x.leave).min(y.leave).min(z.leave);
    let meets = enter <= leave && leave < f32::new(FAR) && region.low_x < region.high_x;
    let start = origin.along(direction, enter);
    let cell_x = first_cell(grid.in_cells(start.x), region.low_x, region.high_x);
    let cell_y = first_cell(grid.in_cells(start.y), region.low_y, region.high_y);
    let cell_z = first_cell(grid.in_cells(start.z), region.low_z, region.high_z);
    VoxelTraversal {
        x: RuntimeCell::new(cell_x),
        y: RuntimeCell::new(cell_y),
        z: RuntimeCell::new(cell_z),
        next_x: RuntimeCell::new(next_plane(&grid, cell_x, origin.x, direction.x)),
        next_y: RuntimeCell::new(next_plane(&grid, cell_y, origin.y, direction.y)),
        next_z: RuntimeCell::new(next_plane(&grid, cell_z, origin.z, direction.z)),
        delta: Point::new(
            spacing_along(&grid, direction.x),
            spacing_along(&grid, direction.y),
            spacing_along(&grid, direction.z),
        ),
        direction: direction.signs(),
        depth: RuntimeCell::new(enter),
        end: leave,
        going: RuntimeCell::new(select(meets, 1u32, 0u32)),
    }
}

/// Where the plane before a cell lies.
#[cube]
fn plane(grid: &Grid, cell: u32) -> f32 {
    f32::cast_from(cell) * grid.spacing - grid.half_extent
}

/// A cell's neighbour along an axis; beyond zero it is far beyond the last.
#[cube]
fn neighbour(cell: u32, direction: f32) -> u32 {
    select(direction < 0.0f32, cell - 1u32, cell + 1u32)
}

#[cube]
impl VoxelTraversal {
    /// Whether there is a present cell.
    pub fn is_going(&self) -> bool {
        self.going.read() > 0u32
    }

    /// Ray depth at which the present cell is entered.
    pub fn enter(&self) -> f32 {
        self.depth.read()
    }

    /// Ray depth at which it is left.
    pub fn leave(&self) -> f32 {
        // Rounding may put a plane before the cell's entry: depths never fall.
        let plane = self.next_x.read().min(self.next_y.read()).min(self.next_z.read());
        plane.min(self.end).max(self.depth.read())
    }

    /// Coordinates of the present cell.
    pub fn low(&self) -> Point {
        Point::new(f32::cast_from(self.x.read()), f32::cast_from(self.y.read()), f32::cast_from(self.z.read()))
    }

    /// Its lowest node.
    pub fn node(&self, nodes: u32) -> u32 {
        (self.z.read() * nodes + self.y.read()) * nodes + self.x.read()
    }

    /// Whether the surface may pass through it, or it is inside: see [`super::occupancy::mark`].
    pub fn is_marked(&self, marks: &[u32], nodes: u32) -> bool {
        let words = words(nodes);
        let word = (self.z.read() * (nodes - 1u32) + self.y.read()) * words + self.x.read() / 32u32;
        ((marks[word as usize] >> (self.x.read() % 32u32)) & 1u32) == 1u32
    }

    /// On to the next cell.
    pub fn advance(&self, region: &Region) {
        let leave = self.leave();
        let (x, y, z) = (self.next_x.read(), self.next_y.read(), self.next_z.read());
        if x <= y && x <= z {
            self.next_x.store(x + self.delta.x);
            self.x.store(neighbour(self.x.read(), self.direction.x));
        } else {
            if y <= z {
                self.next_y.store(y + self.delta.y);
                self.y.store(neighbour(self.y.read(), self.direction.y));
            } else {
                self.next_z.store(z + self.delta.z);
                self.z.store(neighbour(self.z.read(), self.direction.z));
            }
        }
        self.depth.store(leave);
        let (x, y, z) = (self.x.read(), self.y.read(), self.z.read());
        let within = x >= region.low_x
            && x < region.high_x
            && y >= region.low_y
            && y < region.high_y
            && z >= region.low_z
            && z < region.high_z;
        if leave >= self.end || !within {
            self.going.store(0u32);
        }
    }
}

/// Ray depth, between `from` and `to`, at which the interpolated values first reach zero from below; [`NOWHERE`] where
/// they never do, and where the ray starts inside.
#[cube]
pub(crate) fn first_crossing(
    values: &[f32],
    marks: &[u32],
    region: &Region,
    origin: &Point,
    direction: &Point,
    from: f32,
    to: f32,
) -> f32 {
    let grid = region.grid();
    let start = origin.along(direction, from);
    let half = region.half_extent;
    let starts_within = start.x.abs() < half && start.y.abs() < half && start.z.abs() < half;
    let starts_inside = starts_within && grid.slope(values, &start).value >= 0.0f32;
    let mut crossing = f32::new(NOWHERE);
    if !starts_inside {
        let in_cells = direction.over(grid.spacing);
        let first = Point::new(grid.in_cells(origin.x), grid.in_cells(origin.y), grid.in_cells(origin.z));
        let walk = walk(region, origin, direction, from, to);
        while walk.is_going() && crossing < 0.0f32 {
            if walk.is_marked(marks, region.nodes) {
                let length = walk.leave() - walk.enter();
                let at = first.along(&in_cells, walk.enter()).minus(&walk.low());
                let node = walk.node(region.nodes);
                let t = along(values, &grid, node, &at, &in_cells.times(length)).first_crossing();
                if t >= 0.0f32 {
                    crossing = walk.enter() + t * length;
                }
            }
            walk.advance(region);
        }
    }
    crossing
}

/// The trilinear function in a cell on the segment from `at`, `step` long, as a cubic in `[0, 1]`.
#[cube]
fn along(values: &[f32], grid: &Grid, node: u32, a: &Point, b: &Point) -> Cubic {
    let c0 = values[grid.corner(node, 0usize)];
    let c1 = values[grid.corner(node, 1usize)];
    let c2 = values[grid.corner(node, 2usize)];
    let c3 = values[grid.corner(node, 3usize)];
    let c4 = values[grid.corner(node, 4usize)];
    let c5 = values[grid.corner(node, 5usize)];
    let c6 = values[grid.corner(node, 6usize)];
    let c7 = values[grid.corner(node, 7usize)];
    // Coefficients of x, y, xy, z, xz, yz, xyz.
    let k1 = c1 - c0;
    let k2 = c2 - c0;
    let k4 = c4 - c0;
    let k3 = c3 - c2 - k1;
    let k5 = c5 - c4 - k1;
    let k6 = c6 - c4 - k2;
    let k7 = c7 - c6 - c5 + c4 - k3;
    let p = quadratic(a, b, c0, k1, k2, k3);
    let q = quadratic(a, b, k4, k5, k6, k7);
    Cubic { c0: p.x + a.z * q.x, c1: p.y + a.z * q.y + b.z * q.x, c2: p.z + a.z * q.z + b.z * q.y, c3: b.z * q.z }
}

/// `one + x X + y Y + xy X Y` for `X = a.x + b.x t` and `Y = a.y + b.y t`: its coefficients by rising powers of `t`.
#[cube]
fn quadratic(a: &Point, b: &Point, one: f32, x: f32, y: f32, xy: f32) -> Point {
    Point::new(
        one + x * a.x + y * a.y + xy * a.x * a.y,
        x * b.x + y * b.y + xy * (a.x * b.y + a.y * b.x),
        xy * b.x * b.y,
    )
}

#[cfg(test)]
mod tests {
    use dvr_core::voxel::VoxelGrid;

    use super::*;

    #[test]
    fn a_region_holds_what_is_marked_and_the_cells_beside_active_nodes() {
        let grid = VoxelGrid::new(9, 0.5);
        let none = ActiveNodes::none(&grid);
        assert_eq!(region([[0; 3]; 2], &none), [[0; 3]; 2], "nothing");
        assert_eq!(region([[1, 2, 3], [4, 5, 6]], &none), [[1, 2, 3], [4, 5, 6]]);
        let some = [grid.index([0, 4, 5]), grid.index([8, 4, 5])];
        let active = ActiveNodes::new(&grid, |node| some.contains(&node));
        assert_eq!(region([[0; 3]; 2], &active), [[0, 3, 4], [8, 5, 6]], "no cell beyond the grid");
        assert_eq!(region([[2, 0, 5], [3, 1, 8]], &active), [[0, 0, 4], [8, 5, 8]]);
    }
}
