//! The cells that a ray passes through, in order.

use glam::Vec3;

use super::grid::VoxelGrid;

/// A ray's passage through one cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Coordinates of the cell.
    pub cell: [usize; 3],
    /// Ray depth at which the ray enters it.
    pub enter: f32,
    /// Ray depth at which the ray leaves it.
    pub leave: f32,
}

/// Visits the cells of a grid along a ray (Amanatides and Woo 1987), front to back.
#[derive(Clone, Debug)]
pub struct VoxelTraversal {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
    size: f32,
    half_extent: f32,
    low: [i32; 3],
    high: [i32; 3],
    cell: [i32; 3],
    step: [i32; 3],
    /// Ray depth at which the next plane of each axis is crossed, and between two planes.
    next: Vec3,
    delta: Vec3,
    depth: f32,
    end: f32,
    done: bool,
}

impl VoxelTraversal {
    /// The cells between ray depths `from` and `to`, or `None` where the ray misses the grid's cube.
    pub fn new(grid: &VoxelGrid, origin: Vec3, direction: Vec3, from: f32, to: f32) -> Option<Self> {
        Self::within(grid, [[0; 3], [grid.cells(); 3]], origin, direction, from, to)
    }

    /// The same in a box of cells only, from `range[0]` up to but without `range[1]`.
    pub fn within(
        grid: &VoxelGrid,
        range: [[usize; 3]; 2],
        origin: Vec3,
        direction: Vec3,
        from: f32,
        to: f32,
    ) -> Option<Self> {
        let size = grid.spacing();
        let [low, high] = range.map(|corner| corner.map(|c| c as i32));
        let inverse = direction.recip();
        let (mut enter, mut leave) = (from, to);
        for axis in 0..3 {
            let [a, b] = [low, high].map(|corner| corner[axis] as f32 * size - grid.half_extent());
            if direction[axis] == 0.0 {
                if origin[axis] < a || origin[axis] > b {
                    return None;
                }
                continue;
            }
            let (a, b) = ((a - origin[axis]) * inverse[axis], (b - origin[axis]) * inverse[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        if low == high {
            return None;
        }
        if enter > leave || !leave.is_finite() {
            return None;
        }
        let start = grid.to_grid(origin + enter * direction);
        let first = [start.x, start.y, start.z].map(|c| c.floor() as i32);
        let mut walk = Self {
            origin,
            direction,
            inverse,
            size,
            half_extent: grid.half_extent(),
            low,
            high,
            cell: [0, 1, 2].map(|axis| first[axis].clamp(low[axis], high[axis] - 1)),
            step: [0, 1, 2].map(|axis| if direction[axis] < 0.0 { -1 } else { 1 }),
            next: Vec3::INFINITY,
            delta: (inverse * size).abs(),
            depth: enter,
            end: leave,
            done: false,
        };
        walk.next = Vec3::from([0, 1, 2].map(|axis| walk.next_plane(axis)));
        Some(walk)
    }

    /// Coordinates of the cell that comes next; `None` at the end.
    #[inline]
    pub fn cell(&self) -> Option<[usize; 3]> {
        (!self.done).then(|| self.cell.map(|c| c as usize))
    }

    /// Goes on behind the block of cells that the next cell lies in, and behind all that follow while `is_empty` says so of
    /// a block's coordinates. Blocks have `EDGE` cells along an edge, and the first begins where the grid does.
    #[inline]
    pub fn skip_blocks<const EDGE: usize>(&mut self, is_empty: impl Fn([usize; 3]) -> bool) {
        let edge = EDGE as i32;
        // Cells are not negative: a remainder of bits.
        let mut first = self.cell.map(|c| c - (c as u32 % EDGE as u32) as i32);
        let behind = |walk: &Self, axis: usize, first: i32| {
            walk.depth_of_plane(axis, first + if walk.step[axis] > 0 { edge } else { 0 })
        };
        let mut next = [0, 1, 2].map(|axis| behind(self, axis, first[axis]));
        let axis = loop {
            let axis = nearest(next[0], next[1], next[2]);
            self.depth = next[axis].max(self.depth);
            first[axis] += self.step[axis] * edge;
            // The first cell of the next block.
            let cell = if self.step[axis] > 0 { first[axis] } else { first[axis] + edge - 1 };
            self.cell[axis] = cell;
            self.done = self.depth >= self.end || cell < self.low[axis] || cell >= self.high[axis];
            if self.done {
                return;
            }
            if !is_empty(first.map(|first| first as usize / EDGE)) {
                break axis;
            }
            next[axis] = behind(self, axis, first[axis]);
        };
        let at = (self.origin + self.depth * self.direction + self.half_extent) / self.size;
        for other in 0..3 {
            if other != axis {
                let [low, high] = [first[other].max(self.low[other]), (first[other] + edge).min(self.high[other]) - 1];
                self.cell[other] = (at[other].floor() as i32).clamp(low, high);
            }
        }
        self.next = Vec3::from([0, 1, 2].map(|axis| self.next_plane(axis)));
    }

    /// Ray depth at which the ray leaves its cell along an axis.
    #[inline]
    fn next_plane(&self, axis: usize) -> f32 {
        self.depth_of_plane(axis, self.cell[axis] + i32::from(self.step[axis] > 0))
    }

    /// Ray depth of the plane before a cell; never for a ray along it.
    #[inline]
    fn depth_of_plane(&self, axis: usize, cell: i32) -> f32 {
        if self.direction[axis] == 0.0 {
            return f32::INFINITY;
        }
        (cell as f32 * self.size - self.half_extent - self.origin[axis]) * self.inverse[axis]
    }
}

/// The axis of the least depth.
#[inline]
fn nearest(x: f32, y: f32, z: f32) -> usize {
    if x <= y && x <= z {
        0
    } else if y <= z {
        1
    } else {
        2
    }
}

impl Iterator for VoxelTraversal {
    type Item = Segment;

    #[inline]
    fn next(&mut self) -> Option<Segment> {
        if self.done {
            return None;
        }
        let axis = nearest(self.next.x, self.next.y, self.next.z);
        // Rounding may put a plane before the cell's entry: depths never fall.
        let leave = self.next[axis].min(self.end).max(self.depth);
        let segment = Segment { cell: self.cell.map(|c| c as usize), enter: self.depth, leave };
        self.depth = leave;
        self.next[axis] += self.delta[axis];
        self.cell[axis] += self.step[axis];
        self.done = leave >= self.end || self.cell[axis] < self.low[axis] || self.cell[axis] >= self.high[axis];
        Some(segment)
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn segments_are_contiguous_and_lie_in_their_cells() {
        let grid = VoxelGrid::new(18, 0.55);
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut random = || Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        let mut walks = 0;
        for _ in 0..2000 {
            let (origin, direction) = (2.0 * random(), random());
            let Some(walk) = VoxelTraversal::new(&grid, origin, direction, 0.0, f32::INFINITY) else { continue };
            walks += 1;
            let mut depth = None;
            for segment in walk {
                assert!(depth.is_none_or(|d| d == segment.enter) && segment.leave >= segment.enter);
                depth = Some(segment.leave);
                let middle = grid.to_grid(origin + 0.5 * (segment.enter + segment.leave) * direction);
                let low = Vec3::from(segment.cell.map(|c| c as f32));
                assert!((middle - low - 0.5).abs().max_element() < 0.5 + 1e-4, "{segment:?} {middle}");
            }
            let exit = origin + depth.unwrap() * direction;
            assert!((exit.abs().max_element() - 0.55).abs() < 1e-5);
        }
        assert!(walks > 100, "{walks}");
    }

    #[test]
    fn a_block_that_is_left_is_passed_over_and_nothing_else_is() {
        let grid = VoxelGrid::new(22, 0.55);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut random = || Vec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        let mut left = 0;
        for ray in 0..2000 {
            // Some along planes and axes.
            let flat = |v: Vec3| if ray % 7 == 0 { v * Vec3::new(1.0, 0.0, 1.0) } else { v };
            let (origin, direction) = (2.0 * random(), flat(random()));
            let range = [[1, 0, 2], [21, 20, 19]];
            let walk = || VoxelTraversal::within(&grid, range, origin, direction, 0.0, f32::INFINITY);
            let (Some(all), Some(mut walk)) = (walk(), walk()) else { continue };
            let all: Vec<Segment> = all.collect();
            let block = |cell: [usize; 3]| cell.map(|c| c / 4);
            // Some beside each other.
            let is_skipped = |block: [usize; 3]| block.iter().sum::<usize>() % 3 > 0;
            let is_empty = |cell: [usize; 3]| is_skipped(block(cell));
            let mut kept = Vec::new();
            let mut alone = walk.clone();
            while let Some(cell) = walk.cell() {
                if is_empty(cell) {
                    walk.skip_blocks::<4>(is_skipped);
                    assert!(walk.cell().is_none_or(|next| !is_empty(next)), "{cell:?}");
                } else {
                    kept.extend(walk.next());
                }
            }
            // Block by block it is the same, bit for bit.
            let mut one_by_one = Vec::new();
            while let Some(cell) = alone.cell() {
                if is_empty(cell) {
                    alone.skip_blocks::<4>(|_| false);
                    left += 1;
                } else {
                    one_by_one.extend(alone.next());
                }
            }
            assert_eq!(kept, one_by_one, "ray {ray}");
            // Cells that are only just touched may be missed or found, since depths are rounded otherwise.
            let long = |segment: &&Segment| segment.leave - segment.enter > 1e-5;
            let cells = |segments: &[Segment]| segments.iter().filter(long).map(|s| s.cell).collect::<Vec<_>>();
            let expected: Vec<Segment> = all.into_iter().filter(|segment| !is_empty(segment.cell)).collect();
            assert_eq!(cells(&kept), cells(&expected), "ray {ray}");
        }
        assert!(left > 300, "{left}");
    }

    #[test]
    fn rays_along_axes_and_from_inside_are_walked() {
        let grid = VoxelGrid::new(5, 0.5);
        let cells =
            |origin, direction| VoxelTraversal::new(&grid, origin, direction, 0.0, f32::INFINITY).map(Iterator::count);
        assert_eq!(cells(Vec3::new(0.1, 0.1, -1.0), Vec3::Z), Some(4));
        assert_eq!(cells(Vec3::new(0.1, 0.1, 0.1), Vec3::Z), Some(2));
        assert_eq!(cells(Vec3::new(0.6, 0.1, -1.0), Vec3::Z), None);
        assert_eq!(cells(Vec3::new(0.1, 0.1, 1.0), Vec3::Z), None, "behind the origin");
    }
}
