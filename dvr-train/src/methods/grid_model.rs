//! A trained grid field, on the CPU or a GPU.

#[cfg(feature = "gpu")]
use dvr_grid::GpuGridField;
use dvr_grid::GridField;
use dvr_grid::grid_file::stored_values;
use dvr_render::Shader;
use dvr_render::extract::ScalarField;
use glam::Vec3;

use crate::methods::trained_model::TrainedModel;

/// A grid field as files store it.
pub(crate) struct GridModel(pub GridField);

/// The same, rendered and evaluated on a GPU.
#[cfg(feature = "gpu")]
pub(crate) struct GpuGridModel(pub GpuGridField);

impl TrainedModel for GridModel {
    fn shader(&self, _: usize) -> Box<dyn Shader + '_> {
        Box::new(&self.0)
    }

    fn thorough_shader(&self) -> Box<dyn Shader + '_> {
        Box::new(&self.0)
    }

    fn parameters(&self) -> usize {
        stored_values(&self.0)
    }
}

#[cfg(feature = "gpu")]
impl TrainedModel for GpuGridModel {
    fn shader(&self, _: usize) -> Box<dyn Shader + '_> {
        Box::new(&self.0)
    }

    fn thorough_shader(&self) -> Box<dyn Shader + '_> {
        Box::new(&self.0)
    }

    fn parameters(&self) -> usize {
        stored_values(self.0.field())
    }
}

/// Hands every question on to the field within.
macro_rules! as_its_field {
    ($model:ty) => {
        impl ScalarField for $model {
            fn logits(&self, points: &[Vec3]) -> Vec<f32> {
                self.0.logits(points)
            }

            fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
                self.0.gradients(points)
            }

            fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
                self.0.colors(points, normals, directions)
            }

            fn cells(&self) -> Option<usize> {
                self.0.cells()
            }
        }
    };
}

as_its_field!(GridModel);
#[cfg(feature = "gpu")]
as_its_field!(GpuGridModel);
