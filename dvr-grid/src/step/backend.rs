//! What carries out the steps of a run.

use std::borrow::Cow;

use dvr_render::SlopeRule;

use crate::bricks::BrickValues;
use crate::clock::PartTimes;
use crate::color_trust::{Agreement, agreement};
use crate::config::GridConfig;
use crate::error::Result;
use crate::losses::LossSums;
use crate::multires::Grids;
use crate::pixel_order::PixelOrder;
use crate::views::TrainingView;

/// Losses are asked for once in this many steps: a GPU is waited for then.
pub(crate) const REPORT_EVERY: usize = 10;

/// Weight by which colours tend to the mean colour, against about one per ray that sees them: enough for nodes that no
/// ray sees, which would otherwise drift with the coarse levels.
pub(crate) const COLOR_REST: f32 = 1e-5;

/// What a step needs to know.
pub(crate) struct StepInput<'a> {
    pub config: &'a GridConfig,
    pub views: &'a [TrainingView<'a>],
    pub order: &'a PixelOrder,
    /// Rays that earlier steps drew: which pixels come next.
    pub rays_drawn: u64,
    /// The colour that nodes tend to where no ray sees them.
    pub mean_color: [f32; 3],
    /// Factor of the step sizes.
    pub decay: f64,
    /// Factor of the step size of the shape alone.
    pub warm_up: f64,
    /// How the gradient of a depth is damped at grazing rays.
    pub slope_rule: SlopeRule,
    /// Whether the losses are asked for.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "the CPU has them at hand in any case"))]
    pub is_reported: bool,
    pub times: &'a mut PartTimes,
}

impl StepInput<'_> {
    /// Adam's step size for a level of the shape, counted from the coarsest.
    pub fn shape_rate(&self, level: usize) -> f32 {
        (self.config.shape_rate * self.decay * self.warm_up * self.config.shape_rate_ratio.powi(level as i32)) as f32
    }

    /// The same for a level of the colour.
    pub fn color_rate(&self, level: usize) -> f32 {
        (self.config.color_rate * self.decay * self.config.color_rate_ratio.powi(level as i32)) as f32
    }

    /// The weight of the mean smoothness: the other losses are sums over rays, this one is a mean over nodes.
    pub fn smoothness_weight(&self) -> f32 {
        (self.config.losses.smoothness.weight * self.config.rays as f64) as f32
    }
}

/// Carries out the steps of a stage, and owns what they change.
pub(crate) trait StepBackend: Send {
    /// Takes up grids that are new or have changed otherwise than by its steps.
    ///
    /// # Errors
    /// When there is no room for them.
    fn upload(&mut self, grids: Grids) -> Result<()>;

    /// Takes up views that are exposed otherwise than before, or than those it was made with.
    ///
    /// # Errors
    /// When the device fails.
    fn expose(&mut self, views: &[TrainingView]) -> Result<()>;

    /// Takes up other photographs: the same views at another size.
    ///
    /// # Errors
    /// When the device has no room for them.
    fn show(&mut self, views: &[TrainingView]) -> Result<()>;

    /// One step: rays to ray gradients, ray gradients to gradients at nodes, these to parameters. `None` where nobody
    /// asked for the losses and they are not at hand.
    ///
    /// # Errors
    /// When the device fails.
    fn step(&mut self, input: StepInput) -> Result<Option<LossSums>>;

    /// The grids as the steps so far have left them; fetched where a device keeps them.
    ///
    /// # Errors
    /// When the device fails.
    fn grids(&self) -> Result<Cow<'_, Grids>>;

    /// The shape at the nodes as the steps so far have left it: all that is asked for between steps.
    ///
    /// # Errors
    /// When the device fails.
    fn shape_values(&self) -> Result<Cow<'_, BrickValues<1>>>;

    /// How far views agree on the colours of the shape as it is, by the pixels that come after `rays_drawn`.
    ///
    /// # Errors
    /// When the device fails.
    fn agreement(
        &self,
        views: &[TrainingView],
        order: &PixelOrder,
        config: &GridConfig,
        rays_drawn: u64,
    ) -> Result<Agreement> {
        Ok(agreement(&*self.shape_values()?, views, order, config, rays_drawn))
    }

    /// Parameters of the grids: does not wait for a device.
    fn parameters(&self) -> usize;
}
