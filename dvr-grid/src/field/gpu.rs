//! A grid field that is looked at on a graphics processor.

use crate::gpu::{GpuGridView, NodeValues};
use burn::tensor::Device;
use dvr_core::Ray;
use dvr_gpu::DeviceError;
use dvr_render::extract::ScalarField;
use dvr_render::{Shaded, Shader};
use glam::Vec3;

use crate::field::{GridField, GridValues};

/// A [`GridField`] on a device: rays and points are asked there, with the same answers but for rounding.
///
/// A device that fails while it is asked makes its questions panic, as tensors on it do.
pub struct GpuGridField {
    field: GridField,
    viewer: GpuGridView,
}

impl GpuGridField {
    /// Brings a field to a device.
    ///
    /// # Errors
    /// When it is no graphics processor, or the field is too large for it.
    pub fn new(field: GridField, device: &Device) -> Result<Self, DeviceError> {
        fn given(part: &GridValues) -> NodeValues<'_> {
            NodeValues { nodes: part.grid.nodes(), half_extent: part.grid.half_extent(), values: &part.values }
        }
        let viewer = GpuGridView::new(device, given(field.shape()), given(field.color()))?;
        Ok(Self { field, viewer })
    }

    /// The field.
    pub fn field(&self) -> &GridField {
        &self.field
    }
}

/// Numbers a point.
fn triples(points: &[Vec3]) -> Vec<[f32; 3]> {
    points.iter().map(Vec3::to_array).collect()
}

/// An answer. Traits of fields know no failure: that of a device ends the program's work, as one of its tensors' does.
/// (That there is room for questions was found out when the field was brought there.)
fn answered<T>(answer: Result<T, DeviceError>) -> T {
    answer.unwrap_or_else(|problem| panic!("{problem}"))
}

impl Shader for GpuGridField {
    fn shade(&self, rays: &[Ray]) -> Vec<Option<Shaded>> {
        let numbers = |ray: &Ray| {
            let [[a, b, c], [d, e, f]] = [ray.origin, ray.direction].map(|vector| vector.as_vec3().to_array());
            [a, b, c, d, e, f]
        };
        let rays: Vec<_> = rays.iter().map(numbers).collect();
        let shaded = |[depth, r, g, b, x, y, z]: [f32; 7]| {
            (depth >= 0.0).then_some(Shaded { depth, color: [r, g, b], normal: [x, y, z] })
        };
        answered(self.viewer.shade(&rays)).into_iter().map(shaded).collect()
    }
}

impl ScalarField for GpuGridField {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        answered(self.viewer.logits(&triples(points)))
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let gradients = answered(self.viewer.gradients(&triples(points)));
        Some(gradients.into_iter().map(Vec3::from).collect())
    }

    fn colors(&self, points: &[Vec3], _normals: &[Vec3]) -> Option<Vec<[f32; 3]>> {
        Some(answered(self.viewer.colors(&triples(points))))
    }
}
