//! The grid method's trainer, as a run sees it.

use std::collections::BTreeMap;

use dvr_core::Exposure;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_grid::{GridTrainer, TrainerState, grid_file};
use dvr_render::ViewMetrics;

use crate::error::Result;
use crate::learners::learner::{Learner, LearnerState};
use crate::learners::step_report::StepReport;

impl Learner for GridTrainer<'_> {
    fn step(&mut self) -> Result<StepReport> {
        let dvr_grid::StepReport { step, loss, terms, mask_iou, learning_rate } = self.step()?;
        Ok(StepReport { step, loss, terms, mask_iou, learning_rate, samples: 0 })
    }

    fn steps_done(&self) -> usize {
        self.steps_done()
    }

    fn total_steps(&self) -> usize {
        self.total_steps()
    }

    fn validate(&self, pixels: usize) -> Option<ViewMetrics> {
        self.validate(pixels)
    }

    fn model(&self) -> Result<Vec<u8>> {
        Ok(grid_file::to_bytes(&self.field()?).map_err(dvr_grid::Error::from)?)
    }

    fn state(&self) -> Result<LearnerState> {
        let TrainerState { model, training } = self.state()?;
        Ok(LearnerState { model, training })
    }

    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()> {
        let LearnerState { model, training } = state.clone();
        Ok(self.resume(&TrainerState { model, training }, steps)?)
    }

    fn exposures(&self) -> BTreeMap<String, Exposure> {
        self.exposures()
    }

    fn stereo_depths(&self) -> Vec<StereoDepth> {
        self.stereo_depths().to_vec()
    }

    fn notes(&mut self) -> Vec<String> {
        self.notes()
    }
}
