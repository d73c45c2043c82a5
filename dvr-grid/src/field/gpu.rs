//! A grid field that is rendered and asked on a GPU.

use std::sync::Arc;

use burn::tensor::{Device, Tensor};
use dvr_core::Ray;
use dvr_gpu::DeviceError;
use dvr_render::extract::ScalarField;
use dvr_render::{
    Crossing, Differentiable, Field, FieldJet, FieldValues, HostRays, MarchSettings, Marcher, Query, Shaded, Shader,
    Snapshot,
};
use glam::Vec3;

use crate::field::exact_marcher::{ExactCrossing, ExactMarcher};
use crate::field::grid_field::GridField;
use crate::field::tensors::{scalars, triples, vectors};
use crate::gpu::GpuGridView;

/// A [`GridField`] on a device: rays and points are asked there, with the same answers but for rounding.
///
/// As a [`Field`] it takes and gives tensors of the CPU. A device that fails while it is asked makes its questions
/// panic, as tensors on it do. A clone shares what lies on the device.
#[derive(Clone)]
pub struct GpuGridField {
    field: GridField,
    viewer: Arc<GpuGridView>,
}

impl GpuGridField {
    /// Brings a field to a device.
    ///
    /// # Errors
    /// When it is not a GPU, or the field is too large for it.
    pub fn new(field: GridField, device: &Device) -> Result<Self, DeviceError> {
        let viewer = GpuGridView::new(device, &field)?;
        Ok(Self { field, viewer: Arc::new(viewer) })
    }

    /// The field.
    pub fn field(&self) -> &GridField {
        &self.field
    }

    fn colors_at(&self, points: &[Vec3], directions: Option<&[Vec3]>) -> Vec<[f32; 3]> {
        let direction = |i: usize| directions.map_or(Vec3::ZERO, |directions| directions[i]);
        let seen: Vec<_> = points.iter().enumerate().map(|(i, &point)| six((point, direction(i)))).collect();
        answered(self.viewer.colors(&seen))
    }
}

/// Origin and direction of a ray as the device takes them.
fn six((origin, direction): (Vec3, Vec3)) -> [f32; 6] {
    let ([a, b, c], [d, e, f]) = (origin.to_array(), direction.to_array());
    [a, b, c, d, e, f]
}

/// Points as rows of numbers.
fn rows(points: &[Vec3]) -> Vec<[f32; 3]> {
    points.iter().map(Vec3::to_array).collect()
}

/// An answer. Traits of fields know no failure: that of a device ends the program's work, as one of its tensors' does.
/// (That there is room for questions was found out when the field was brought there.)
fn answered<T>(answer: Result<T, DeviceError>) -> T {
    answer.unwrap_or_else(|problem| panic!("{problem}"))
}

impl Shader for GpuGridField {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        let rays: Vec<_> = rays.iter().map(|ray| six((ray.origin.as_vec3(), ray.direction.as_vec3()))).collect();
        let shaded = |[depth, r, g, b, x, y, z]: [f32; 7]| {
            (depth >= 0.0).then_some(Shaded { depth, color: [r, g, b], normal: [x, y, z] })
        };
        answered(self.viewer.shade(&rays)).into_iter().map(shaded).collect()
    }
}

impl ScalarField for GpuGridField {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        answered(self.viewer.logits(&rows(points)))
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let gradients = answered(self.viewer.gradients(&rows(points)));
        Some(gradients.into_iter().map(Vec3::from).collect())
    }

    fn colors(&self, points: &[Vec3], _normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        Some(self.colors_at(points, directions))
    }

    fn cells(&self) -> Option<usize> {
        self.field.cells()
    }
}

impl Field for GpuGridField {
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

    /// That of the tensors, the CPU.
    fn device(&self) -> Device {
        self.field.device()
    }
}

/// Derivatives come from the CPU's copy of the field: they are asked at few points.
impl Differentiable for GpuGridField {
    fn jet(&self, query: &Query, direction: Tensor<2>) -> FieldJet {
        self.field.jet(query, direction)
    }

    fn occupancy_gradient(&self, query: &Query) -> Tensor<2> {
        self.field.occupancy_gradient(query)
    }
}

impl Crossing for GpuGridField {
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

impl ExactCrossing for GpuGridField {
    fn first_crossings(&self, rays: &HostRays) -> Vec<Option<f32>> {
        // The device's rays have no interval: they start where it does.
        let start = |i: usize| (rays.at(i, rays.entry[i]), rays.direction[i]);
        let numbers: Vec<_> = (0..rays.origin.len()).map(|i| six(start(i))).collect();
        let within = |(i, [depth, ..]): (usize, [f32; 7])| {
            (depth >= 0.0).then_some(rays.entry[i] + depth).filter(|&depth| depth <= rays.exit[i])
        };
        answered(self.viewer.shade(&numbers)).into_iter().enumerate().map(within).collect()
    }
}
