//! What a run has learned, ready to be looked at and extracted.

use burn::module::Module;
use burn::tensor::Device;
use dvr_core::UnitCube;
#[cfg(feature = "gpu")]
use dvr_grid::GpuGridField;
use dvr_grid::{GridField, grid_file};
use dvr_model::{Conditioned, Decoder, EncoderConfig};
use dvr_render::extract::{FieldSurface, ScalarField};
use dvr_render::{FieldShader, MarchSettings, RenderSettings, Shader, SkipGrid};
use glam::Vec3;

use crate::error::{Error, Result};
use crate::learners::learner::restore_module;
use crate::methods::method::Method;
use crate::objects::{ObjectModel, ObjectsConfig};
use crate::run::checkpoint::Checkpoint;

/// Cells along an edge of the grid that lets the rendering of a network skip empty space.
const SKIP_CELLS: usize = 64;

/// The field of a checkpoint, whatever the method.
pub enum Model {
    /// The publication's network, of one scene or bound to the code of one of many objects.
    Network {
        /// Its parameters, without gradient tracking.
        surface: Box<FieldSurface<Conditioned>>,
        /// Where its surface may be.
        skip: SkipGrid,
    },
    /// A field on grids.
    Grid(Box<GridField>),
    /// The same on a graphics processor.
    #[cfg(feature = "gpu")]
    GpuGrid(Box<GpuGridField>),
}

impl Model {
    /// The field that a checkpoint holds.
    ///
    /// # Errors
    /// When its parameters do not fit its configuration, or are damaged.
    pub fn load(checkpoint: &Checkpoint, device: &Device) -> Result<Self> {
        match &checkpoint.header.method {
            Method::Network(config) => {
                let decoder: Decoder = restore_module(&checkpoint.state.model, config.model.init(device))?.valid();
                Ok(Self::of_field(decoder.unconditioned()))
            }
            Method::Objects(config) => Err(Error::Config(match config.encoder {
                EncoderConfig::Codes { objects } => {
                    format!("this run knows {objects} objects by their codes: say which with --object N, from 0")
                }
                _ => {
                    "this run learned many objects and needs a picture to know which: use `dvr predict RUN IMAGE`, or \
                      `dvr eval RUN --data DATASET`"
                        .into()
                }
            })),
            Method::Grid(_) => {
                let field = grid_file::from_bytes(&checkpoint.state.model);
                let field = field.map_err(|e| Error::Config(format!("the checkpoint's field cannot be read: {e}")))?;
                Self::of_grid(field, device)
            }
        }
    }

    /// The field of one of the objects, counted from 0, that a run knows by their codes.
    ///
    /// # Errors
    /// When the run knows no objects by codes, or not so many; as [`Model::load`].
    pub fn of_object(checkpoint: &Checkpoint, object: usize, device: &Device) -> Result<Self> {
        let Method::Objects(ObjectsConfig { encoder: EncoderConfig::Codes { objects }, .. }) =
            &checkpoint.header.method
        else {
            return Err(Error::Config(
                "the run has no learned codes of objects, of which --object could choose one".into(),
            ));
        };
        if object >= *objects {
            return Err(Error::Config(format!("--object {object}: the run knows {objects} objects, counted from 0")));
        }
        Ok(Self::of_field(ObjectModel::load(checkpoint, device)?.field_of_row(object)))
    }

    /// A network that is bound to an object, as something to look at and to extract.
    pub fn of_field(field: Conditioned) -> Self {
        let surface = Box::new(FieldSurface::new(field));
        let skip = SkipGrid::build(surface.as_ref(), UnitCube::default(), SKIP_CELLS);
        Self::Network { surface, skip }
    }

    /// A field on grids; on a graphics processor it is looked at there.
    fn of_grid(field: GridField, device: &Device) -> Result<Self> {
        #[cfg(feature = "gpu")]
        if dvr_render::is_gpu(device) {
            let refused =
                |problem| crate::device::refused(problem, "a field trained with a lower --capacity takes less");
            return Ok(Self::GpuGrid(Box::new(GpuGridField::new(field, device).map_err(refused)?)));
        }
        let _ = device;
        Ok(Self::Grid(Box::new(field)))
    }

    /// What rays see of it; a network is asked at `samples` points across the cube.
    pub fn shader(&self, samples: usize) -> Box<dyn Shader + '_> {
        match self {
            Self::Network { surface, skip } => {
                let march = MarchSettings { steps: samples, ..MarchSettings::default() };
                let settings = RenderSettings { march, ..RenderSettings::default() };
                Box::new(FieldShader::new(surface.field(), settings, Some(skip)))
            }
            Self::Grid(field) => Box::new(field.as_ref()),
            #[cfg(feature = "gpu")]
            Self::GpuGrid(field) => Box::new(field.as_ref()),
        }
    }

    /// The same, but a network is asked everywhere: for parts that the grid of [`Model::shader`] misses.
    pub fn thorough_shader(&self) -> Box<dyn Shader + '_> {
        match self {
            Self::Network { surface, .. } => {
                let march = MarchSettings { steps: 64, ..MarchSettings::default() };
                Box::new(FieldShader::new(surface.field(), RenderSettings { march, ..RenderSettings::default() }, None))
            }
            Self::Grid(field) => Box::new(field.as_ref()),
            #[cfg(feature = "gpu")]
            Self::GpuGrid(field) => Box::new(field.as_ref()),
        }
    }

    /// How many numbers it consists of.
    pub fn parameters(&self) -> usize {
        match self {
            Self::Network { surface, .. } => surface.field().decoder().num_params(),
            Self::Grid(field) => grid_file::stored_values(field),
            #[cfg(feature = "gpu")]
            Self::GpuGrid(field) => grid_file::stored_values(field.field()),
        }
    }

    fn field(&self) -> &dyn ScalarField {
        match self {
            Self::Network { surface, .. } => surface.as_ref(),
            Self::Grid(field) => field.as_ref(),
            #[cfg(feature = "gpu")]
            Self::GpuGrid(field) => field.as_ref(),
        }
    }
}

impl ScalarField for Model {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        self.field().logits(points)
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        self.field().gradients(points)
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        self.field().colors(points, normals, directions)
    }
}
