//! A grid of all space: the object's cube as it is, and what is around it contracted into a shell (Barron et al., *Mip-NeRF
//! 360*, 2022, equation 10, with the greatest coordinate for the norm).

use glam::Vec3;

/// How thick the shell is, half edges of the cube.
const SHELL: f32 = 0.5;

/// Half the edge of all that is contracted.
const REACH: f32 = 1.0 + SHELL;

/// Nodes along an edge of a brick.
const BRICK: usize = 4;

/// Nodes of a brick, which are next to each other in memory.
pub(super) const BRICK_NODES: usize = BRICK.pow(3);

/// Nodes in contracted space. Points have the cube for [-1, 1]^3.
///
/// Nodes are numbered brick by brick, x first: a ray passes few bricks, and so few pages of memory. Bricks go beyond
/// the last nodes where these do not fill them.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContractedGrid {
    nodes: usize,
    /// Along an edge.
    bricks: usize,
}

/// The cell in which a point lies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Its first corner.
    pub node: usize,
    /// From that to its neighbours in x, y and z.
    next: [usize; 3],
    /// How far the point is from it, in spacings.
    fraction: Vec3,
}

impl ContractedGrid {
    /// So many nodes along an edge, at least 2.
    pub const fn new(nodes: usize) -> Self {
        Self { nodes, bricks: nodes.div_ceil(BRICK) }
    }

    /// Nodes in all, with those that only fill bricks.
    pub const fn len(&self) -> usize {
        self.bricks.pow(3) * BRICK_NODES
    }

    /// From node to node, contracted.
    pub fn spacing(&self) -> f32 {
        2.0 * REACH / (self.nodes - 1) as f32
    }

    /// The corners of the cell whose first corner is a node; `None` where there is no cell.
    pub fn corners(&self, node: usize) -> Option<[usize; 8]> {
        let at = self.coordinates(node);
        at.into_iter().all(|at| at + 1 < self.nodes).then(|| corners(node, self.next(at)))
    }

    /// From a brick to its neighbours in x, y and z.
    fn strides(&self) -> [usize; 3] {
        [BRICK_NODES, BRICK_NODES * self.bricks, BRICK_NODES * self.bricks.pow(2)]
    }

    /// From the node at these coordinates to its neighbours in x, y and z.
    fn next(&self, at: [usize; 3]) -> [usize; 3] {
        let strides = self.strides();
        std::array::from_fn(|axis| {
            let within = BRICK.pow(axis as u32);
            if at[axis] % BRICK == BRICK - 1 { strides[axis] - (BRICK - 1) * within } else { within }
        })
    }

    fn node(&self, at: [usize; 3]) -> usize {
        let strides = self.strides();
        (0..3).map(|axis| at[axis] / BRICK * strides[axis] + at[axis] % BRICK * BRICK.pow(axis as u32)).sum()
    }

    fn coordinates(&self, node: usize) -> [usize; 3] {
        let strides = self.strides();
        std::array::from_fn(|axis| {
            BRICK * (node / strides[axis] % self.bricks) + node % BRICK_NODES / BRICK.pow(axis as u32) % BRICK
        })
    }

    /// Contracted position of a node.
    pub fn position(&self, node: usize) -> Vec3 {
        Vec3::from(self.coordinates(node).map(|at| at as f32)) * self.spacing() - REACH
    }

    /// The cell of a contracted point.
    pub fn cell(&self, contracted: Vec3) -> Cell {
        let last = self.nodes as f32 - 1.001;
        let place = ((contracted + REACH) / self.spacing()).clamp(Vec3::ZERO, Vec3::splat(last));
        let first = place.floor();
        let at = first.to_array().map(|at| at as usize);
        Cell { node: self.node(at), next: self.next(at), fraction: place - first }
    }
}

impl Cell {
    /// Its corners, x first.
    #[inline]
    pub fn corners(&self) -> [usize; 8] {
        corners(self.node, self.next)
    }

    /// What each corner counts at the point.
    #[inline]
    pub fn weights(&self) -> [f32; 8] {
        let (f, g) = (self.fraction, Vec3::ONE - self.fraction);
        let across = [g.x * g.y, f.x * g.y, g.x * f.y, f.x * f.y];
        std::array::from_fn(|corner| across[corner % 4] * if corner < 4 { g.z } else { f.z })
    }
}

#[inline]
fn corners(node: usize, [x, y, z]: [usize; 3]) -> [usize; 8] {
    [0, x, y, x + y, z, x + z, y + z, x + y + z].map(|offset| node + offset)
}

/// A point contracted, and how that changes along a direction.
pub(super) fn contract(point: Vec3, direction: Vec3) -> (Vec3, Vec3) {
    let norm = point.abs().max_element();
    if norm <= 1.0 {
        return (point, direction);
    }
    let axis = point.abs().max_position();
    let norm_along = direction[axis] * point[axis].signum();
    let contracted = 1.0 + SHELL * (1.0 - 1.0 / norm);
    let contracted_along = SHELL / norm.powi(2) * norm_along;
    let scale = contracted / norm;
    let scale_along = (contracted_along - scale * norm_along) / norm;
    (scale * point, scale * direction + scale_along * point)
}

/// The point that is contracted to this one, no further out than `far`.
pub(super) fn expand(contracted: Vec3, far: f32) -> Vec3 {
    let norm = contracted.abs().max_element();
    if norm <= 1.0 {
        return contracted;
    }
    contracted / norm / (1.0 - (norm - 1.0) / SHELL).max(1.0 / far)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    const POINTS: [Vec3; 4] =
        [Vec3::new(0.3, -0.9, 0.2), Vec3::new(1.5, 0.4, -0.7), Vec3::new(-3.0, 2.9, 8.0), Vec3::new(0.1, -20.0, 3.0)];

    #[test]
    fn the_cube_stays_and_what_is_around_it_is_contracted_and_expanded_again() {
        assert_eq!(contract(POINTS[0], Vec3::X), (POINTS[0], Vec3::X));
        for point in POINTS {
            let (contracted, _) = contract(point, Vec3::X);
            assert!(contracted.abs().max_element() < REACH);
            assert!(expand(contracted, 100.0).distance(point) < 1e-4 * point.length(), "{point}");
        }
        assert!(expand(Vec3::splat(REACH), 30.0).distance(Vec3::splat(30.0)) < 1e-3);
    }

    #[test]
    fn the_change_along_a_direction_is_that_of_differences() {
        let direction = Vec3::new(0.3, -0.5, 0.8);
        for point in POINTS {
            let (before, along) = contract(point - 0.01 * direction, direction);
            let (after, along_after) = contract(point + 0.01 * direction, direction);
            let differences = (after - before) / 0.02;
            assert!((0.5 * (along + along_after)).distance(differences) < 1e-3, "{point}");
        }
    }

    #[test]
    fn each_node_has_a_number_and_cells_end_at_the_last() {
        let grid = ContractedGrid::new(6);
        let numbers: HashSet<usize> = (0..grid.len()).map(|node| grid.node(grid.coordinates(node))).collect();
        assert_eq!(numbers, (0..grid.len()).collect());
        assert_eq!((0..grid.len()).filter(|node| grid.corners(*node).is_some()).count(), 5 * 5 * 5);
    }

    #[test]
    fn a_place_gives_back_what_is_linear() {
        let grid = ContractedGrid::new(6);
        let linear = |at: Vec3| at.dot(Vec3::new(1.0, -2.0, 0.5)) + 0.3;
        for point in POINTS {
            let (contracted, _) = contract(point, Vec3::X);
            let cell = grid.cell(contracted);
            assert_eq!(grid.corners(cell.node), Some(cell.corners()));
            let corners = cell.corners().into_iter().zip(cell.weights());
            let found: f32 = corners.map(|(corner, weight)| weight * linear(grid.position(corner))).sum();
            assert!((found - linear(contracted)).abs() < 2e-3, "{found} {}", linear(contracted));
        }
    }
}
