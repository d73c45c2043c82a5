//! A trained field that is sampled along rays: a network.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use dvr_core::UnitCube;
use dvr_render::extract::{FieldSurface, ScalarField};
use dvr_render::{Crossing, FieldShader, MarchSettings, RenderSettings, Shader, SkipGrid};
use glam::Vec3;

use crate::error::{Error, Result};
use crate::methods::trained_model::TrainedModel;

/// Cells along an edge of the grid that lets rendering skip empty space.
const SKIP_CELLS: usize = 64;

/// Samples across the cube where nothing is skipped.
const THOROUGH_SAMPLES: usize = 64;

/// Writes a field for other programs.
pub(crate) type SaveField<F> = Arc<dyn Fn(&F, &Path) -> Result<()> + Send + Sync>;

/// A field without gradient tracking.
pub(crate) struct FieldModel<F> {
    surface: FieldSurface<F>,
    parameters: usize,
    /// Where its surface may be; found when it is first rendered.
    skip: OnceLock<SkipGrid>,
    save: Option<SaveField<F>>,
}

impl<F: Crossing> FieldModel<F> {
    /// Of so many parameters.
    pub fn new(field: F, parameters: usize, save: Option<SaveField<F>>) -> Self {
        Self { surface: FieldSurface::new(field), parameters, skip: OnceLock::new(), save }
    }
}

fn settings(samples: usize) -> RenderSettings {
    RenderSettings { march: MarchSettings { steps: samples, ..MarchSettings::default() }, ..RenderSettings::default() }
}

impl<F: Crossing + Send> TrainedModel for FieldModel<F> {
    fn shader(&self, samples: usize) -> Box<dyn Shader + '_> {
        let skip = self.skip.get_or_init(|| SkipGrid::build(&self.surface, UnitCube::default(), SKIP_CELLS));
        Box::new(FieldShader::new(self.surface.field(), settings(samples), Some(skip)))
    }

    fn thorough_shader(&self) -> Box<dyn Shader + '_> {
        Box::new(FieldShader::new(self.surface.field(), settings(THOROUGH_SAMPLES), None))
    }

    fn parameters(&self) -> usize {
        self.parameters
    }

    fn save_network(&self, path: &Path) -> Result<()> {
        self.save.as_ref().map_or(Err(Error::NoNetwork), |save| save(self.surface.field(), path))
    }
}

impl<F: Crossing> ScalarField for FieldModel<F> {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        self.surface.logits(points)
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        self.surface.gradients(points)
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        self.surface.colors(points, normals, directions)
    }
}
