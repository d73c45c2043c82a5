//! Trilinear interpolation in plain tensor operations: the slow twin of the lattice operations.

use burn::tensor::{Bool, Int, Tensor};
use dvr_kernels::Lattice;

/// Points in a lattice.
pub struct PlainCells {
    lattice: Lattice,
    /// Lowest node of each point's cell, counted in nodes along each axis, `[n, 3]`.
    low: Tensor<2>,
    /// Position in the cell, `[n, 3]`.
    at: Tensor<2>,
    /// Where a coordinate lies outside the cube, `[n, 3]`.
    outside: Tensor<2, Bool>,
}

impl PlainCells {
    /// Locates points, `[n, 3]`.
    pub fn new(lattice: Lattice, points: Tensor<2>) -> Self {
        let cells = lattice.cells() as f64;
        let position = (points + f64::from(lattice.half_extent())) * per_cell(lattice);
        let outside = position.clone().lower_elem(0.0).bool_or(position.clone().greater_elem(cells));
        let position = position.clamp(0.0, cells);
        let low = position.clone().detach().floor().clamp(0.0, cells - 1.0);
        Self { lattice, at: position - low.clone(), low, outside }
    }

    /// The values between `[nodes, C]`, `[n, C]`.
    pub fn value(&self, values: &Tensor<2>) -> Tensor<2> {
        self.sum(values, |corner| self.side(corner, 0) * self.side(corner, 1) * self.side(corner, 2))
    }

    /// Their derivatives along directions `[n, 3]`, `[n, C]`.
    pub fn derivative(&self, values: &Tensor<2>, directions: Tensor<2>) -> Tensor<2> {
        let along = (directions * per_cell(self.lattice)).mask_fill(self.outside.clone(), 0.0);
        self.sum(values, |corner| {
            let slope = |axis| if is_high(corner, axis) { column(&along, axis) } else { -column(&along, axis) };
            let [x, y, z] = [0, 1, 2].map(|axis| self.side(corner, axis));
            slope(0) * y.clone() * z.clone() + slope(1) * x.clone() * z + slope(2) * x * y
        })
    }

    fn sum(&self, values: &Tensor<2>, weight: impl Fn(usize) -> Tensor<2>) -> Tensor<2> {
        let parts = (0..8).map(|corner| values.clone().select(0, self.index(corner)) * weight(corner));
        parts.reduce(|sum, part| sum + part).expect("a cell has corners")
    }

    /// How near a corner is along an axis, `[n, 1]`.
    fn side(&self, corner: usize, axis: usize) -> Tensor<2> {
        let at = column(&self.at, axis);
        if is_high(corner, axis) { at } else { -at + 1.0 }
    }

    /// The node at a corner, `[n]`.
    fn index(&self, corner: usize) -> Tensor<1, Int> {
        let nodes = self.lattice.nodes() as i32;
        let node = |axis| column(&self.low, axis).int().squeeze_dim::<1>(1) + i32::from(is_high(corner, axis));
        (node(2) * nodes + node(1)) * nodes + node(0)
    }
}

fn per_cell(lattice: Lattice) -> f64 {
    lattice.cells() as f64 / (2.0 * f64::from(lattice.half_extent()))
}

fn is_high(corner: usize, axis: usize) -> bool {
    corner >> axis & 1 == 1
}

fn column(tensor: &Tensor<2>, axis: usize) -> Tensor<2> {
    tensor.clone().narrow(1, axis, 1)
}
