//! A grid of all space: the object's cube as it is, and what is around it contracted into a shell (Barron et al., *Mip-NeRF
//! 360*, 2022, equation 10, with the greatest coordinate for the norm).

use glam::Vec3;

/// How thick the shell is, half edges of the cube.
const SHELL: f32 = 0.5;

/// Half the edge of all that is contracted.
const REACH: f32 = 1.0 + SHELL;

/// Nodes in contracted space, numbered x first. Points have the cube for [-1, 1]^3.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContractedGrid {
    nodes: usize,
}

/// Where a point lies in a grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// The first corner of its cell.
    pub node: usize,
    /// Weights of the cell's corners, in the order of [`ContractedGrid::corners`].
    pub weights: [f32; 8],
}

impl ContractedGrid {
    /// So many nodes along an edge, at least 2.
    pub fn new(nodes: usize) -> Self {
        Self { nodes }
    }

    /// Nodes in all.
    pub fn len(&self) -> usize {
        self.nodes.pow(3)
    }

    /// From node to node, contracted.
    pub fn spacing(&self) -> f32 {
        2.0 * REACH / (self.nodes - 1) as f32
    }

    /// From the first corner of a cell to all.
    pub fn corners(&self) -> [usize; 8] {
        let [x, y, z] = [1, self.nodes, self.nodes.pow(2)];
        [0, x, y, x + y, z, x + z, y + z, x + y + z]
    }

    /// Whether a node is the first corner of a cell.
    pub fn has_cell(&self, node: usize) -> bool {
        self.coordinates(node).into_iter().all(|at| at + 1 < self.nodes)
    }

    fn coordinates(&self, node: usize) -> [usize; 3] {
        let n = self.nodes;
        [node % n, node / n % n, node / n / n]
    }

    /// Contracted position of a node.
    pub fn position(&self, node: usize) -> Vec3 {
        Vec3::from(self.coordinates(node).map(|at| at as f32)) * self.spacing() - REACH
    }

    /// The place of a contracted point.
    pub fn place(&self, contracted: Vec3) -> Place {
        let last = self.nodes as f32 - 1.001;
        let at = ((contracted + REACH) / self.spacing()).clamp(Vec3::ZERO, Vec3::splat(last));
        let first = at.floor();
        let [x, y, z] = first.to_array().map(|at| at as usize);
        let (f, g) = (at - first, Vec3::ONE - (at - first));
        let across = [g.x * g.y, f.x * g.y, g.x * f.y, f.x * f.y];
        let weights = std::array::from_fn(|corner| across[corner % 4] * if corner < 4 { g.z } else { f.z });
        Place { node: (z * self.nodes + y) * self.nodes + x, weights }
    }
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
    fn a_place_gives_back_what_is_linear() {
        let grid = ContractedGrid::new(6);
        let linear = |at: Vec3| at.dot(Vec3::new(1.0, -2.0, 0.5)) + 0.3;
        for point in POINTS {
            let (contracted, _) = contract(point, Vec3::X);
            let Place { node, weights } = grid.place(contracted);
            assert!(grid.has_cell(node));
            let corners = grid.corners().into_iter().zip(weights);
            let found: f32 = corners.map(|(offset, weight)| weight * linear(grid.position(node + offset))).sum();
            assert!((found - linear(contracted)).abs() < 2e-3, "{found} {}", linear(contracted));
        }
    }
}
