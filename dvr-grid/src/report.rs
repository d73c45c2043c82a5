//! What a step and a run report.

use crate::config::GridConfig;
use crate::losses::LossSums;

/// What a step did.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// The step, counted from 1.
    pub step: usize,
    /// The loss. On a GPU it is read back in every tenth step, and is that of the last of these otherwise.
    pub loss: f64,
    /// Name and weighted value of each term, as [`crate::losses::NAMES`] lists them.
    pub terms: Vec<(&'static str, f64)>,
    /// Intersection over union of mask and hits in this batch.
    pub mask_iou: f64,
    /// Adam's step size at the coarsest level.
    pub learning_rate: f64,
}

impl StepReport {
    pub(crate) fn new(step: usize, config: &GridConfig, sums: &LossSums, learning_rate: f64) -> Self {
        let terms = config.losses.weighted(sums, config.rays, config.compared_views);
        Self {
            step,
            loss: terms.iter().map(|(_, value)| value).sum(),
            terms,
            mask_iou: if sums.union == 0 { 1.0 } else { sums.intersection as f64 / sums.union as f64 },
            learning_rate,
        }
    }
}

/// What a trainer needs to go on, and what it has learned.
#[derive(Clone, Debug)]
pub struct TrainerState {
    /// The field, as [`crate::grid_file`] stores it.
    pub model: Vec<u8>,
    /// Parameters, moments and progress.
    pub training: Vec<u8>,
}
