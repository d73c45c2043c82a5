//! What a run has learned, ready to be looked at and extracted.

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::UnitCube;
use dvr_model::{Decoder, LatticeField, lattice_file};
use dvr_render::extract::{FieldSurface, ScalarField};
use dvr_render::{FieldShader, MarchSettings, RenderSettings, Shader, SkipGrid};
use glam::Vec3;

use crate::checkpoint::Checkpoint;
use crate::error::{Error, Result};
use crate::learner::restore_module;
use crate::method::Method;

/// Cells along an edge of the grid that lets the rendering of a network skip empty space.
const SKIP_CELLS: usize = 64;

/// The field of a checkpoint, whatever the method.
pub enum Model {
    /// The publication's network.
    Network {
        /// Its parameters, without gradient tracking.
        surface: Box<FieldSurface<Decoder>>,
        /// Where its surface may be.
        skip: SkipGrid,
    },
    /// A field on lattices.
    Lattice(Box<LatticeField>),
}

impl Model {
    /// The field that a checkpoint holds.
    ///
    /// # Errors
    /// When its parameters do not fit its configuration, or are damaged.
    pub fn load(checkpoint: &Checkpoint, device: &Device) -> Result<Self> {
        match &checkpoint.header.method {
            Method::Network(config) => {
                let decoder = restore_module(&checkpoint.state.model, config.model.init(device))?.valid();
                let surface = Box::new(FieldSurface::new(decoder));
                let skip = SkipGrid::build(surface.as_ref(), UnitCube::default(), SKIP_CELLS);
                Ok(Self::Network { surface, skip })
            }
            Method::Objects(_) => Err(Error::Config(
                "this run learned many objects and needs a picture to know which: use `dvr predict RUN IMAGE`, or \
                 `dvr eval RUN --data DATASET`"
                    .into(),
            )),
            Method::Lattice(_) => {
                let field = lattice_file::from_bytes(&checkpoint.state.model);
                let field = field.map_err(|e| Error::Config(format!("the checkpoint's field cannot be read: {e}")))?;
                Ok(Self::Lattice(Box::new(field)))
            }
        }
    }

    /// What rays see of it; a network is asked at `samples` points across the cube.
    pub fn shader(&self, samples: usize) -> Box<dyn Shader + '_> {
        match self {
            Self::Network { surface, skip } => {
                let march = MarchSettings { steps: samples, ..MarchSettings::default() };
                let settings = RenderSettings { march, ..RenderSettings::default() };
                Box::new(FieldShader::new(surface.field(), settings, Some(skip)))
            }
            Self::Lattice(field) => Box::new(field.as_ref()),
        }
    }

    /// The same, but a network is asked everywhere: for parts that the grid of [`Model::shader`] misses.
    pub fn thorough_shader(&self) -> Box<dyn Shader + '_> {
        match self {
            Self::Network { surface, .. } => {
                let march = MarchSettings { steps: 64, ..MarchSettings::default() };
                Box::new(FieldShader::new(surface.field(), RenderSettings { march, ..RenderSettings::default() }, None))
            }
            Self::Lattice(field) => Box::new(field.as_ref()),
        }
    }

    /// How many numbers it consists of.
    pub fn parameters(&self) -> usize {
        match self {
            Self::Network { surface, .. } => surface.field().num_params(),
            Self::Lattice(field) => lattice_file::stored_values(field),
        }
    }
}

impl ScalarField for Model {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        match self {
            Self::Network { surface, .. } => surface.logits(points),
            Self::Lattice(field) => field.logits(points),
        }
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        match self {
            Self::Network { surface, .. } => surface.gradients(points),
            Self::Lattice(field) => field.gradients(points),
        }
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3]) -> Option<Vec<[f32; 3]>> {
        match self {
            Self::Network { surface, .. } => surface.colors(points, normals),
            Self::Lattice(field) => field.colors(points, normals),
        }
    }
}
