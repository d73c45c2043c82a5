//! A grid field as a field on tensors: the numbers are computed on the CPU, per point.
//!
//! Answers are constants: the values at the nodes are learned by the grid's own trainer, not through a graph.

use burn::tensor::{Device, Tensor, TensorData};
use dvr_render::extract::ScalarField;
use dvr_render::{
    Crossing, Differentiable, Field, FieldJet, FieldValues, HostRays, MarchSettings, Marcher, Query, Shader, Snapshot,
};
use glam::Vec3;
use rayon::prelude::*;

use crate::field::exact_marcher::{ExactCrossing, ExactMarcher};
use crate::field::grid_field::GridField;

/// Rows of an `[n, 3]` tensor.
pub(super) fn vectors(tensor: &Tensor<2>) -> Vec<Vec3> {
    let flat: Vec<f32> = tensor.clone().into_data().iter::<f32>().collect();
    flat.as_chunks().0.iter().map(|&v| Vec3::from_array(v)).collect()
}

/// Numbers, one per point, `[n]`.
pub(super) fn scalars(values: Vec<f32>, device: &Device) -> Tensor<1> {
    let count = values.len();
    Tensor::from_data(TensorData::new(values, [count]), device)
}

/// Three numbers per point, `[n, 3]`.
pub(super) fn triples(values: Vec<[f32; 3]>, device: &Device) -> Tensor<2> {
    let count = values.len();
    Tensor::from_data(TensorData::new(values.into_flattened(), [count, 3]), device)
}

impl Field for GridField {
    fn evaluate(&self, query: &Query) -> FieldValues {
        let (points, device) = (vectors(&query.points), query.points.device());
        let directions = query.directions.as_ref().map(vectors);
        FieldValues {
            occupancy_logit: scalars(self.logits(&points), &device),
            color: triples(self.colors_at(&points, directions.as_deref()), &device),
        }
    }

    fn occupancy_logit(&self, query: &Query) -> Tensor<1> {
        scalars(self.logits(&vectors(&query.points)), &query.points.device())
    }

    /// The CPU.
    fn device(&self) -> Device {
        Device::flex()
    }
}

/// The derivatives of the interpolation, exact but on the faces between cells, where there are two.
impl Differentiable for GridField {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        let (points, device) = (vectors(&query.points), query.points.device());
        let steps = vectors(&direction);
        let directions = query.directions.as_ref().map(vectors);
        let shape = self.shape();
        let slope = |i: usize| {
            let (point, step) = (points[i], steps[i]);
            let (_, gradient) = shape.value_and_gradient(point);
            let viewing = directions.as_ref().map(|directions| directions[i]);
            (gradient.dot(step), self.color_slope(point, step, viewing))
        };
        let (logit, color) = (0..points.len()).into_par_iter().with_min_len(512).map(slope).unzip();
        let derivative = FieldValues { occupancy_logit: scalars(logit, &device), color: triples(color, &device) };
        FieldJet { value: self.evaluate(query), derivative }
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        let shape = self.shape();
        let gradient = |p: &Vec3| shape.value_and_gradient(*p).1.to_array();
        let gradients = vectors(&query.points).par_iter().with_min_len(512).map(gradient).collect();
        triples(gradients, &query.points.device())
    }
}

impl Crossing for GridField {
    fn own_marcher(&self, settings: MarchSettings) -> Option<Box<dyn Marcher + '_>> {
        Some(Box::new(ExactMarcher::new(self, settings)))
    }

    fn snapshots(&self) -> Vec<Snapshot> {
        vec![Box::new(self.clone())]
    }

    fn own_shader(&self) -> Option<&dyn Shader> {
        Some(self)
    }
}

impl ExactCrossing for GridField {
    fn first_crossings(&self, rays: &HostRays) -> Vec<Option<f32>> {
        let crossing = |i: usize| self.first_crossing(rays.origin[i], rays.direction[i], rays.entry[i], rays.exit[i]);
        (0..rays.origin.len()).into_par_iter().with_min_len(64).map(crossing).collect()
    }
}
