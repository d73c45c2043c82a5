//! What a step tells.

use burn::tensor::Tensor;
use dvr_render::is_gpu;

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::learners::objective::StepLoss;

/// What a step did, for logging.
#[derive(Clone, Debug)]
pub struct StepReport {
    /// The step, counted from 1.
    pub step: usize,
    /// The loss. On a GPU it is read back in every tenth step, and is that of the last of these otherwise.
    pub loss: f64,
    /// Name and weighted value of each term, of the same step as `loss`.
    pub terms: Vec<(&'static str, f64)>,
    /// Intersection over union of mask and hits in this batch; not a number where nothing is compared so.
    pub mask_iou: f64,
    /// Adam's step size.
    pub learning_rate: f64,
    /// Samples on a ray.
    pub samples: usize,
}

/// What a step's configuration says of it.
pub struct StepSettings {
    /// The step, counted from 1.
    pub step: usize,
    /// Whether no other follows.
    pub is_last: bool,
    /// Adam's step size.
    pub learning_rate: f64,
    /// Samples on a ray.
    pub samples: usize,
}

impl StepSettings {
    /// Of the step that follows so many.
    pub(crate) fn of(config: &TrainConfig, steps_done: usize) -> Self {
        Self {
            step: steps_done + 1,
            is_last: steps_done + 1 == config.steps,
            learning_rate: config.learning_rate_at(steps_done),
            samples: config.samples_at(steps_done),
        }
    }
}

impl StepReport {
    /// Of a step whose loss is known; `last` is the report of the step before.
    ///
    /// # Errors
    /// When the loss is not finite.
    pub(crate) fn of(loss: &StepLoss, settings: StepSettings, last: Option<&Self>) -> Result<Self> {
        let StepSettings { step, is_last, learning_rate, samples } = settings;
        let (value, terms) = match last {
            Some(last) if is_gpu(&loss.total.device()) && !step.is_multiple_of(READ_EVERY) && !is_last => {
                (last.loss, last.terms.clone())
            }
            _ => read_losses(loss),
        };
        if !value.is_finite() {
            return Err(Error::Diverged { step, value });
        }
        Ok(Self { step, loss: value, terms, mask_iou: loss.mask_iou, learning_rate, samples })
    }
}

/// On a GPU, the loss is read back once in so many steps: reading it makes the program wait for the device. The rows of
/// `metrics.csv` are as far apart.
pub(crate) const READ_EVERY: usize = 10;

/// The loss and its terms, read back together.
fn read_losses(loss: &StepLoss) -> (f64, Vec<(&'static str, f64)>) {
    let terms = loss.terms.iter().map(|(_, term)| term);
    let all: Vec<_> = std::iter::once(&loss.total).chain(terms).cloned().collect();
    let mut values = Tensor::cat(all, 0).into_data().iter::<f64>().collect::<Vec<_>>().into_iter();
    let total = values.next().unwrap_or(f64::NAN);
    (total, loss.terms.iter().map(|(name, _)| *name).zip(values).collect())
}
