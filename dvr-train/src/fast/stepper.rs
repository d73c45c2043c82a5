//! Who carries out steps: this processor, or a graphics processor that keeps the parameters to itself.

use super::clock::PartTimes;
use super::config::FastConfig;
use super::levels::Levels;
use super::rays::Tally;
use super::views::{FastView, PixelOrder};
use crate::error::Result;

/// Weight by which colours tend to the mean colour, against about one a ray that sees them: enough for what no ray
/// sees, which would otherwise drift with the coarse levels.
pub(super) const COLOR_REST: f32 = 1e-5;

/// What a step is told.
pub(super) struct StepJob<'a> {
    pub config: &'a FastConfig,
    pub views: &'a [FastView<'a>],
    pub order: &'a PixelOrder,
    /// Rays that earlier steps drew: which pixels come next.
    pub rays_drawn: u64,
    /// The colour that nodes tend to where no ray sees them.
    pub mean_color: [f32; 3],
    /// Factor of the step sizes.
    pub decay: f64,
    /// Whether anybody will look at the losses.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "on the processor they are at hand in any case"))]
    pub is_reported: bool,
    pub times: &'a mut PartTimes,
}

impl StepJob<'_> {
    /// Adam's step size for a level of the shape, counted from the coarsest.
    pub fn shape_rate(&self, level: usize) -> f32 {
        (self.config.shape_rate * self.decay * self.config.shape_rate_ratio.powi(level as i32)) as f32
    }

    /// The same for a level of the colour.
    pub fn color_rate(&self, level: usize) -> f32 {
        (self.config.color_rate * self.decay * self.config.color_rate_ratio.powi(level as i32)) as f32
    }

    /// What the roughness of a node near the surface weighs: losses are sums over rays, this one is a mean over nodes.
    pub fn roughness_weight(&self) -> f32 {
        (self.config.losses.roughness * self.config.rays as f64) as f32
    }
}

/// What a step's losses were.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StepSums {
    /// Over its rays.
    pub tally: Tally,
    /// Mean over nodes near the surface, without its weight.
    pub roughness: f32,
}

/// States of the levels of shape and colour, as [`Levels::state`] gives them.
pub(super) type LevelStates = (Vec<f32>, Vec<f32>);

/// Carries out the steps of a stage.
pub(super) trait Stepper: Send {
    /// Takes up levels that are new or have changed otherwise than by its steps.
    ///
    /// # Errors
    /// When there is no room for them.
    fn enter(&mut self, shape: &Levels<1>, color: &Levels<3>) -> Result<()>;

    /// One step: rays to lessons, lessons to gradients, gradients to parameters. `None` where nobody asked for the
    /// losses and they are not at hand.
    ///
    /// # Errors
    /// When the device fails.
    fn step(&mut self, job: StepJob, shape: &mut Levels<1>, color: &mut Levels<3>) -> Result<Option<StepSums>>;

    /// What the levels have become; `None` where steps change the levels that they are given, so that these are what
    /// is.
    ///
    /// # Errors
    /// When the device fails.
    fn levels(&self) -> Result<Option<LevelStates>>;
}
