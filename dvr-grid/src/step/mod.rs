//! Who carries out steps: this processor, or a graphics processor that keeps the parameters to itself.

mod cpu;
#[cfg(feature = "gpu")]
mod device;
mod gather;
mod rays;

use crate::clock::PartTimes;
use crate::config::GridConfig;
use crate::error::Result;
use crate::multires::MultiResGrid;
use crate::views::{PixelOrder, TrainingView};
use rays::LossSums;

/// Weight by which colours tend to the mean colour, against about one a ray that sees them: enough for what no ray
/// sees, which would otherwise drift with the coarse levels.
pub(crate) const COLOR_REST: f32 = 1e-5;

/// What a step is told.
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
    /// Whether anybody will look at the losses.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "on the processor they are at hand in any case"))]
    pub is_reported: bool,
    pub times: &'a mut PartTimes,
}

impl StepInput<'_> {
    /// Adam's step size for a level of the shape, counted from the coarsest.
    pub fn shape_rate(&self, level: usize) -> f32 {
        (self.config.shape_rate * self.decay * self.config.shape_rate_ratio.powi(level as i32)) as f32
    }

    /// The same for a level of the colour.
    pub fn color_rate(&self, level: usize) -> f32 {
        (self.config.color_rate * self.decay * self.config.color_rate_ratio.powi(level as i32)) as f32
    }

    /// What the smoothness of a node near the surface weighs: losses are sums over rays, this one is a mean over nodes.
    pub fn smoothness_weight(&self) -> f32 {
        (self.config.losses.smoothness * self.config.rays as f64) as f32
    }
}

/// What a step's losses were.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StepSums {
    /// Over its rays.
    pub rays: LossSums,
    /// Mean over nodes near the surface, without its weight.
    pub smoothness: f32,
}

/// States of the levels of shape and colour, as [`MultiResGrid::state`] gives them.
pub(crate) type GridStates = (Vec<f32>, Vec<f32>);

/// Carries out the steps of a stage.
pub(crate) trait StepBackend: Send {
    /// Takes up levels that are new or have changed otherwise than by its steps.
    ///
    /// # Errors
    /// When there is no room for them.
    fn enter(&mut self, shape: &MultiResGrid<1>, color: &MultiResGrid<3>) -> Result<()>;

    /// One step: rays to ray_gradients, ray_gradients to gradients, gradients to parameters. `None` where nobody asked for the
    /// losses and they are not at hand.
    ///
    /// # Errors
    /// When the device fails.
    fn step(
        &mut self,
        job: StepInput,
        shape: &mut MultiResGrid<1>,
        color: &mut MultiResGrid<3>,
    ) -> Result<Option<StepSums>>;

    /// What the levels have become; `None` where steps change the levels that they are given, so that these are what
    /// is.
    ///
    /// # Errors
    /// When the device fails.
    fn levels(&self) -> Result<Option<GridStates>>;
}

pub(crate) use cpu::CpuBackend;
#[cfg(feature = "gpu")]
pub(crate) use device::GpuBackend;
pub(crate) use rays::mean_object_color;
