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
        for axis in 0..3 {
            if direction[axis] != 0.0 {
                let plane = (walk.cell[axis] + i32::from(walk.step[axis] > 0)) as f32 * size - grid.half_extent();
                walk.next[axis] = (plane - origin[axis]) * inverse[axis];
            }
        }
        Some(walk)
    }
}

impl Iterator for VoxelTraversal {
    type Item = Segment;

    #[inline]
    fn next(&mut self) -> Option<Segment> {
        if self.done {
            return None;
        }
        let Vec3 { x, y, z } = self.next;
        let axis = if x <= y && x <= z {
            0
        } else if y <= z {
            1
        } else {
            2
        };
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
