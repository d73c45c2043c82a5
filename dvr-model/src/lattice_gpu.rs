//! The lattice operations on a graphics processor.

use burn::backend::Cube;
use burn::backend::ops::FloatTensorOps;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Slice;
use dvr_gpu::{LatticeQuery, lattice_by_points, lattice_by_values, lattice_interpolate};
use dvr_kernels::Lattice;

use crate::lattice_op::{Asked, LatticeGradients, LatticeOp};

fn query(
    lattice: &Lattice,
    values: &FloatTensor<Cube>,
    points: &FloatTensor<Cube>,
    directions: Option<&FloatTensor<Cube>>,
) -> LatticeQuery {
    LatticeQuery {
        nodes: lattice.nodes(),
        half_extent: lattice.half_extent(),
        channels: values.meta.shape()[1],
        points: points.clone(),
        directions: directions.cloned(),
    }
}

impl LatticeOp for Cube {
    fn lattice_interpolate(
        values: FloatTensor<Self>,
        points: FloatTensor<Self>,
        lattice: Lattice,
    ) -> FloatTensor<Self> {
        lattice_interpolate(&query(&lattice, &values, &points, None), &values)
    }

    fn lattice_jet(
        values: FloatTensor<Self>,
        points: FloatTensor<Self>,
        directions: FloatTensor<Self>,
        lattice: Lattice,
    ) -> FloatTensor<Self> {
        lattice_interpolate(&query(&lattice, &values, &points, Some(&directions)), &values)
    }
}

impl LatticeGradients for Cube {
    fn by_values(
        asked: &Asked<Self>,
        directions: Option<&FloatTensor<Self>>,
        by: &FloatTensor<Self>,
    ) -> FloatTensor<Self> {
        lattice_by_values(&query(&asked.lattice, &asked.values, &asked.points, directions), by)
    }

    fn by_points(asked: &Asked<Self>, by: &FloatTensor<Self>) -> FloatTensor<Self> {
        lattice_by_points(&query(&asked.lattice, &asked.values, &asked.points, None), &asked.values, by)
    }

    fn jet_by_points(
        asked: &Asked<Self>,
        directions: &FloatTensor<Self>,
        by: &FloatTensor<Self>,
    ) -> [FloatTensor<Self>; 2] {
        let both = lattice_by_points(
            &query(&asked.lattice, &asked.values, &asked.points, Some(directions)),
            &asked.values,
            by,
        );
        [0, 3].map(|first| Self::float_slice(both.clone(), &[Slice::full(), Slice::from(first..first + 3)]))
    }
}
