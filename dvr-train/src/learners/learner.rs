//! What a run needs of whatever it trains.

use std::collections::BTreeMap;

use dvr_core::Exposure;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_render::ViewMetrics;

use crate::error::Result;
use crate::learners::step_report::StepReport;

/// What a learner has learned, and what it needs to go on learning.
#[derive(Clone, Debug)]
pub struct LearnerState {
    /// Enough to render and extract.
    pub model: Vec<u8>,
    /// Optimiser and schedule; empty where the model is final.
    pub training: Vec<u8>,
}

/// A field in training, as a run sees it.
pub trait Learner {
    /// One step.
    ///
    /// # Errors
    /// When the loss is no number.
    fn step(&mut self) -> Result<StepReport>;

    /// Steps done so far.
    fn steps_done(&self) -> usize;

    /// Steps after which training is done. May fall while training goes on, where nothing more is gained.
    fn total_steps(&self) -> usize;

    /// Metrics on about so many pixels of the validation views; `None` where there are none.
    fn validate(&self, pixels: usize) -> Option<ViewMetrics>;

    /// What it has learned so far, as [`crate::Method::load`] takes it.
    ///
    /// # Errors
    /// When it cannot be put in bytes.
    fn model(&self) -> Result<Vec<u8>>;

    /// What a checkpoint keeps.
    ///
    /// # Errors
    /// When it cannot be put in bytes.
    fn state(&self) -> Result<LearnerState>;

    /// Goes on where `state` was taken, after so many steps.
    ///
    /// # Errors
    /// When the state is damaged or another configuration's.
    fn resume(&mut self, state: &LearnerState, steps: usize) -> Result<()>;

    /// The exposures that it corrects photographs by, with their names: none where it takes all as they are.
    fn exposures(&self) -> BTreeMap<String, Exposure> {
        BTreeMap::new()
    }

    /// The depths that it found in the views before training, where it looked for some.
    fn stereo_depths(&self) -> Vec<StereoDepth> {
        Vec::new()
    }

    /// What it has to say for people since it was last asked.
    fn notes(&mut self) -> Vec<String> {
        Vec::new()
    }
}
