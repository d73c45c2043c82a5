//! A field on a multi-resolution voxel grid: seconds a scene.

use burn::tensor::Device;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::{Cancellation, Supervision, View};
#[cfg(feature = "gpu")]
use dvr_grid::GpuGridField;
use dvr_grid::{GridConfig, GridTrainer, grid_file};
use serde_json::Value;

use crate::error::{Error, Result};
use crate::learners::learner::Learner;
#[cfg(feature = "gpu")]
use crate::methods::grid_model::GpuGridModel;
use crate::methods::grid_model::GridModel;
use crate::methods::method::{Method, Needs, Schedule, Start, check_scene_supervision};
use crate::methods::overrides::{overridden, visible};
use crate::methods::record::CommonSettings;
use crate::methods::trained_model::TrainedModel;

/// Steps between validations, and between checkpoints.
const SCHEDULE: Schedule = Schedule { validate_every: 100, checkpoint_every: 500, best: None };

/// A field on a multi-resolution voxel grid.
#[derive(Clone, Debug)]
pub struct GridMethod {
    name: &'static str,
    config: GridConfig,
}

/// The method with its defaults.
pub fn grid(supervision: Supervision) -> GridMethod {
    GridMethod::named("grid", GridConfig::new(supervision))
}

impl GridMethod {
    /// With a configuration of one's own.
    pub fn new(config: GridConfig) -> Self {
        Self::named("grid", config)
    }

    pub(crate) fn named(name: &'static str, config: GridConfig) -> Self {
        Self { name, config }
    }

    /// The configuration.
    pub fn settings(&self) -> &GridConfig {
        &self.config
    }
}

impl Method for GridMethod {
    fn name(&self) -> &str {
        self.name
    }

    fn config(&self) -> Result<Value> {
        visible(&self.config, &[])
    }

    fn common(&self) -> CommonSettings {
        let GridConfig { supervision, seed, steps, hold_out_every, .. } = self.config;
        CommonSettings { supervision, seed, steps, hold_out_every }
    }

    fn with_overrides(&self, overrides: &Value) -> Result<Box<dyn Method>> {
        Ok(Box::new(Self { name: self.name, config: overridden(&self.config, overrides, &[], &GridConfig::ranges())? }))
    }

    fn check(&self) -> Result<()> {
        self.config.check().map_err(Error::from)?;
        check_scene_supervision(self.config.supervision)
    }

    fn schedule(&self) -> Schedule {
        SCHEDULE
    }

    fn needs(&self) -> Needs {
        Needs { depth: self.config.losses.depth.weight > 0.0, sparse_points: false }
    }

    fn start<'a>(&self, start: Start<'a, '_>) -> Result<Box<dyn Learner + 'a>> {
        if !start.data_parallel.is_empty() {
            return Err(Error::OneDevice { method: self.name.to_owned() });
        }
        start.observer.phase("measuring the masks", 1);
        let Start { train, validation, device, cancellation, .. } = start;
        Ok(Box::new(GridTrainer::start_on(&device, train, validation, self.config.clone(), cancellation)?))
    }

    fn load(&self, model: &[u8], device: &Device) -> Result<Box<dyn TrainedModel>> {
        let broken = |e: dvr_grid::Error| Error::Damaged { what: "the grid field", problem: e.to_string() };
        let field = grid_file::from_bytes(model).map_err(|e| broken(e.into()))?;
        #[cfg(feature = "gpu")]
        if dvr_render::is_gpu(device) {
            return Ok(Box::new(GpuGridModel(GpuGridField::new(field, device)?)));
        }
        let _ = device;
        Ok(Box::new(GridModel(field)))
    }

    fn stereo_depths(&self, train: &[&View], cancellation: &Cancellation) -> Result<Vec<StereoDepth>> {
        Ok(dvr_grid::stereo_depths(train.to_vec(), &self.config, cancellation)?)
    }

    fn host_memory(&self, train: &[&View]) -> u64 {
        self.config.memory_estimate(train)
    }

    fn most_cells(&self) -> Option<usize> {
        Some(self.config.last_cells())
    }

    fn trains_on_gpu(&self) -> bool {
        self.config.steps > 0
    }

    fn is_compact(&self) -> bool {
        true
    }

    fn camera_refinement(&self) -> GridConfig {
        self.config.clone()
    }
}
