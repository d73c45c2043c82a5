//! Trilinear interpolation on the device, with everything that differentiation asks of it.
//!
//! Gradients by the nodes' values are added up in whole numbers: floating-point sums of many work-items differ from run
//! to run, and not all devices have them. The unit of these sums is the largest possible sum over `2^30`, so that
//! nothing overflows.

mod kernel;
mod place;

use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Cube, TensorMetadata};
use burn::tensor::{FloatDType, IntDType, Shape};
use cubecl::calculate_cube_count_elemwise;
use cubecl::prelude::*;

/// Tensors of a graphics processor.
type Float = FloatTensor<Cube>;

/// A lattice of nodes over a cube around the origin, and how points are to be looked up in it.
#[derive(Clone, Debug)]
pub struct LatticeQuery {
    /// Nodes along an edge.
    pub nodes: usize,
    /// Half the edge length.
    pub half_extent: f32,
    /// Numbers a node.
    pub channels: usize,
    /// The points, `[n, 3]`.
    pub points: Float,
    /// Directions of derivatives, `[n, 3]`; `None` where values alone are asked for.
    pub directions: Option<Float>,
}

/// Work-items a group.
const UNITS: u32 = 64;

impl LatticeQuery {
    fn count(&self) -> usize {
        self.points.shape()[0]
    }

    /// Columns of answers: values, then derivatives.
    fn columns(&self) -> usize {
        if self.directions.is_some() { 2 * self.channels } else { self.channels }
    }

    /// Directions, or something that no kernel reads.
    fn directions_or_points(&self) -> Float {
        contiguous(self.directions.as_ref().unwrap_or(&self.points))
    }

    fn blank(&self, rows: usize, columns: usize) -> Float {
        Cube::float_zeros(Shape::new([rows, columns]), &self.points.device(), FloatDType::F32)
    }

    /// Groups for so many work-items.
    fn cubes(&self, count: usize) -> CubeCount {
        calculate_cube_count_elemwise(&self.points.client, count, CubeDim::new_1d(UNITS))
    }
}

/// A tensor whose numbers lie row by row, as kernels read them.
fn contiguous(tensor: &Float) -> Float {
    if tensor.is_contiguous() { tensor.clone() } else { tensor.copy() }
}

/// `values [nodes^3, C]` at the points, `[n, C]`; with directions `[n, 2 C]`, values and then derivatives along them.
pub fn lattice_interpolate(query: &LatticeQuery, values: &Float) -> Float {
    let count = query.count();
    let out = query.blank(count, query.columns());
    if count > 0 {
        kernel::interpolate::launch(
            &query.points.client,
            query.cubes(count),
            CubeDim::new_1d(UNITS),
            contiguous(values).into_buffer_arg(),
            contiguous(&query.points).into_buffer_arg(),
            query.directions_or_points().into_buffer_arg(),
            out.clone().into_buffer_arg(),
            count as u32,
            query.nodes as u32,
            query.half_extent,
            query.channels,
            query.directions.is_some(),
        );
    }
    out
}

/// The gradient by the nodes' values, `[nodes^3, C]`, from that by [`lattice_interpolate`]'s answer: the same bits in
/// every run.
pub fn lattice_by_values(query: &LatticeQuery, by: &Float) -> Float {
    let count = query.count();
    let numbers = query.nodes.pow(3);
    let out = query.blank(numbers, query.channels);
    if count == 0 {
        return out;
    }
    let (client, jet) = (query.points.client.clone(), query.directions.is_some());
    let (points, directions, by) = (contiguous(&query.points), query.directions_or_points(), contiguous(by));
    let bounds = query.blank(count, 1);
    kernel::bound::launch(
        &client,
        query.cubes(count),
        CubeDim::new_1d(UNITS),
        points.clone().into_buffer_arg(),
        directions.clone().into_buffer_arg(),
        by.clone().into_buffer_arg(),
        bounds.clone().into_buffer_arg(),
        count as u32,
        query.nodes as u32,
        query.half_extent,
        query.channels,
        jet,
    );
    // Where all gradients are zero, any unit will do.
    let most = Cube::float_clamp_min(Cube::float_max(bounds), 1e-30.into());
    let sums: IntTensor<Cube> =
        Cube::int_zeros(Shape::new([numbers, query.channels]), &query.points.device(), IntDType::I32);
    kernel::scatter::launch(
        &client,
        query.cubes(count),
        CubeDim::new_1d(UNITS),
        points.into_buffer_arg(),
        directions.into_buffer_arg(),
        by.into_buffer_arg(),
        most.clone().into_buffer_arg(),
        sums.clone().into_buffer_arg(),
        count as u32,
        query.nodes as u32,
        query.half_extent,
        query.channels,
        jet,
    );
    let length = numbers * query.channels;
    kernel::gathered::launch(
        &client,
        query.cubes(length),
        CubeDim::new_1d(UNITS),
        sums.into_buffer_arg(),
        most.into_buffer_arg(),
        out.clone().into_buffer_arg(),
        length as u32,
        count as u32,
    );
    out
}

/// The gradient by the points, `[n, 3]`, from that by [`lattice_interpolate`]'s answer; with directions `[n, 6]`, that
/// by the points and then by the directions.
pub fn lattice_by_points(query: &LatticeQuery, values: &Float, by: &Float) -> Float {
    let (count, jet) = (query.count(), query.directions.is_some());
    let out = query.blank(count, if jet { 6 } else { 3 });
    if count > 0 {
        kernel::by_points::launch(
            &query.points.client,
            query.cubes(count),
            CubeDim::new_1d(UNITS),
            contiguous(values).into_buffer_arg(),
            contiguous(&query.points).into_buffer_arg(),
            query.directions_or_points().into_buffer_arg(),
            contiguous(by).into_buffer_arg(),
            out.clone().into_buffer_arg(),
            count as u32,
            query.nodes as u32,
            query.half_extent,
            query.channels,
            jet,
        );
    }
    out
}
