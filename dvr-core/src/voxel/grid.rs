//! A cube of nodes with trilinear interpolation between them.

use glam::Vec3;

/// The nodes of a regular grid over the cube `[-half_extent, half_extent]^3`; x runs fastest, then y, then z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelGrid {
    nodes: usize,
    half_extent: f32,
}

/// Where a point lies in a grid: a cell by the index of its lowest node, and the position in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Index of the node with the smallest coordinates.
    pub node: usize,
    /// Position in the cell, each coordinate in `[0, 1]`.
    pub at: Vec3,
}

impl VoxelGrid {
    /// `nodes` along each edge, at least 2.
    ///
    /// # Panics
    /// With fewer than 2 nodes, or a half extent that is not positive.
    pub fn new(nodes: usize, half_extent: f32) -> Self {
        assert!(nodes >= 2 && half_extent > 0.0, "{nodes} nodes over +-{half_extent} make no grid");
        Self { nodes, half_extent }
    }

    /// Nodes along an edge.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Cells along an edge.
    pub fn cells(&self) -> usize {
        self.nodes - 1
    }

    /// Half the edge length.
    pub fn half_extent(&self) -> f32 {
        self.half_extent
    }

    /// Number of nodes.
    #[expect(clippy::len_without_is_empty, reason = "a grid has at least eight nodes")]
    pub fn len(&self) -> usize {
        self.nodes.pow(3)
    }

    /// Distance between neighbouring nodes.
    pub fn spacing(&self) -> f32 {
        2.0 * self.half_extent / self.cells() as f32
    }

    /// Coordinates of a node, counted in nodes.
    pub fn coordinates(&self, node: usize) -> [usize; 3] {
        [node % self.nodes, node / self.nodes % self.nodes, node / (self.nodes * self.nodes)]
    }

    /// Index of a node.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.nodes + y) * self.nodes + x
    }

    /// The nodes across the edges of a node: six, fewer at the border of the grid.
    pub fn neighbours(&self, node: usize) -> impl Iterator<Item = usize> + use<> {
        let (grid, at) = (*self, self.coordinates(node));
        (0..6).filter_map(move |side| {
            let (axis, mut next) = (side / 2, at);
            next[axis] = if side % 2 == 0 { at[axis].checked_sub(1)? } else { at[axis] + 1 };
            (next[axis] < grid.nodes).then(|| grid.index(next))
        })
    }

    /// Whether a node lies on the border of the grid.
    pub fn is_on_border(&self, node: usize) -> bool {
        self.coordinates(node).iter().any(|&c| c == 0 || c + 1 == self.nodes)
    }

    /// Where a node lies.
    pub fn position(&self, node: usize) -> Vec3 {
        let [x, y, z] = self.coordinates(node);
        Vec3::new(x as f32, y as f32, z as f32) * self.spacing() - self.half_extent
    }

    /// A point in units of cells from the lowest corner.
    pub fn to_grid(&self, point: Vec3) -> Vec3 {
        (point + self.half_extent) / self.spacing()
    }

    /// The cell that a point lies in; points outside belong to the nearest point of the cube.
    pub fn locate(&self, point: Vec3) -> Cell {
        let grid = self.to_grid(point).clamp(Vec3::ZERO, Vec3::splat(self.cells() as f32));
        let last = self.cells() - 1;
        let low = [grid.x, grid.y, grid.z].map(|c| (c as usize).min(last));
        let at = grid - Vec3::new(low[0] as f32, low[1] as f32, low[2] as f32);
        Cell { node: self.index(low), at }
    }

    /// Offsets from a cell's lowest node to its corners, x fastest.
    pub fn corner_offsets(&self) -> [usize; 8] {
        let (y, z) = (self.nodes, self.nodes * self.nodes);
        [0, 1, y, y + 1, z, z + 1, z + y, z + y + 1]
    }

    /// The values at a cell's corners, x fastest.
    pub fn corners(&self, values: &[f32], node: usize) -> [f32; 8] {
        let (n, plane) = (self.nodes, self.nodes * self.nodes);
        let pair = |i: usize| [values[i], values[i + 1]];
        let ([a, b], [c, d]) = (pair(node), pair(node + n));
        let ([e, f], [g, h]) = (pair(node + plane), pair(node + plane + n));
        [a, b, c, d, e, f, g, h]
    }

    /// The interpolated value at a point.
    pub fn value(&self, values: &[f32], point: Vec3) -> f32 {
        let cell = self.locate(point);
        cell.value(&self.corners(values, cell.node))
    }

    /// The interpolated value at a point and its gradient in space.
    pub fn value_and_gradient(&self, values: &[f32], point: Vec3) -> (f32, Vec3) {
        let cell = self.locate(point);
        let (value, gradient) = cell.value_and_gradient(&self.corners(values, cell.node));
        (value, gradient / self.spacing())
    }
}

impl Cell {
    /// Weights of the corners, x fastest; they sum to one.
    pub fn weights(&self) -> [f32; 8] {
        let (b, a) = (self.at, Vec3::ONE - self.at);
        let (l, h) = (a.y * a.z, b.y * b.z);
        let (m, n) = (b.y * a.z, a.y * b.z);
        [a.x * l, b.x * l, a.x * m, b.x * m, a.x * n, b.x * n, a.x * h, b.x * h]
    }

    /// The value between corners.
    pub fn value(&self, corners: &[f32; 8]) -> f32 {
        let Vec3 { x, y, z } = self.at;
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along_x: [f32; 4] = std::array::from_fn(|i| lerp(corners[2 * i], corners[2 * i + 1], x));
        lerp(lerp(along_x[0], along_x[1], y), lerp(along_x[2], along_x[3], y), z)
    }

    /// The value between corners and its gradient, per cell.
    pub fn value_and_gradient(&self, c: &[f32; 8]) -> (f32, Vec3) {
        let Vec3 { x, y, z } = self.at;
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let dx: [f32; 4] = std::array::from_fn(|i| c[2 * i + 1] - c[2 * i]);
        let vx: [f32; 4] = std::array::from_fn(|i| c[2 * i] + dx[i] * x);
        let (low, high) = (lerp(vx[0], vx[1], y), lerp(vx[2], vx[3], y));
        let gradient = Vec3::new(
            lerp(lerp(dx[0], dx[1], y), lerp(dx[2], dx[3], y), z),
            lerp(vx[1] - vx[0], vx[3] - vx[2], z),
            high - low,
        );
        (lerp(low, high, z), gradient)
    }

    /// Derivatives of the gradient `(per cell) . direction` by the corners, x fastest: what spreads a loss on the
    /// gradient.
    pub fn gradient_weights(&self, direction: Vec3) -> [f32; 8] {
        let (b, a) = (self.at, Vec3::ONE - self.at);
        std::array::from_fn(|corner| {
            let high = [corner & 1, corner >> 1 & 1, corner >> 2 & 1].map(|bit| bit == 1);
            let side = |axis: usize| if high[axis] { b[axis] } else { a[axis] };
            let slope = |axis: usize| if high[axis] { direction[axis] } else { -direction[axis] };
            slope(0) * side(1) * side(2) + side(0) * slope(1) * side(2) + side(0) * side(1) * slope(2)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A function that trilinear interpolation reproduces.
    fn trilinear(p: Vec3) -> f32 {
        0.3 + p.x - 2.0 * p.y + 0.5 * p.z + 4.0 * p.x * p.y - p.y * p.z + 2.0 * p.x * p.y * p.z
    }

    fn gradient(p: Vec3) -> Vec3 {
        Vec3::new(
            1.0 + 4.0 * p.y + 2.0 * p.y * p.z,
            -2.0 + 4.0 * p.x - p.z + 2.0 * p.x * p.z,
            0.5 - p.y + 2.0 * p.x * p.y,
        )
    }

    fn grid() -> (VoxelGrid, Vec<f32>) {
        let grid = VoxelGrid::new(6, 0.55);
        (grid, (0..grid.len()).map(|i| trilinear(grid.position(i))).collect())
    }

    #[test]
    fn nodes_have_six_neighbours_and_fewer_at_the_border() {
        let grid = VoxelGrid::new(4, 1.0);
        let of = |at| grid.neighbours(grid.index(at)).map(|node| grid.coordinates(node)).collect::<Vec<_>>();
        assert_eq!(of([1, 2, 1]), [[0, 2, 1], [2, 2, 1], [1, 1, 1], [1, 3, 1], [1, 2, 0], [1, 2, 2]]);
        assert_eq!(of([0, 3, 0]), [[1, 3, 0], [0, 2, 0], [0, 3, 1]]);
        let border = (0..grid.len()).filter(|&node| grid.is_on_border(node)).count();
        assert_eq!(border, 64 - 8);
    }

    #[test]
    fn trilinear_functions_are_reproduced_with_their_gradient() {
        let (grid, values) = grid();
        for p in [Vec3::new(0.1, -0.3, 0.44), Vec3::splat(-0.55), Vec3::splat(0.55), Vec3::new(0.11, 0.0, -0.2)] {
            let (value, slope) = grid.value_and_gradient(&values, p);
            assert!((value - trilinear(p)).abs() < 1e-5, "{p}");
            assert!((grid.value(&values, p) - value).abs() < 1e-6);
            assert!((slope - gradient(p)).length() < 1e-4, "{p}: {slope} and {}", gradient(p));
        }
    }

    #[test]
    fn weights_are_the_derivatives_of_the_value_and_of_the_gradient() {
        let (grid, values) = grid();
        let p = Vec3::new(0.13, -0.31, 0.4);
        let cell = grid.locate(p);
        let corners = grid.corners(&values, cell.node);
        let sum = |weights: [f32; 8]| weights.iter().zip(corners).map(|(w, c)| w * c).sum::<f32>();
        assert!((sum(cell.weights()) - cell.value(&corners)).abs() < 1e-6);
        let direction = Vec3::new(0.3, -0.5, 0.7);
        let along = cell.value_and_gradient(&corners).1.dot(direction);
        assert!((sum(cell.gradient_weights(direction)) - along).abs() < 1e-6);
    }

    #[test]
    fn indices_and_positions_agree() {
        let (grid, _) = grid();
        for node in 0..grid.len() {
            assert_eq!(grid.index(grid.coordinates(node)), node);
            assert!((grid.to_grid(grid.position(node)) - grid.to_grid(grid.position(node)).round()).length() < 1e-5);
        }
        let offsets = grid.corner_offsets();
        assert_eq!(offsets.map(|o| grid.coordinates(o)), [0, 1, 2, 3, 4, 5, 6, 7].map(|i| [i & 1, i >> 1 & 1, i >> 2]));
    }
}
