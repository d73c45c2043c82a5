//! Steps on a graphics processor, on which everything stays that is learned.
//!
//! A step is given its rays (which pixels, which views to compare with: the same as on the processor), drawn for some
//! steps at once. It is waited for where its losses are asked for, and where the levels are.

use std::time::Instant;

use crate::gpu::{GpuLevels, GpuLosses, GpuStep, GpuStepInput, Photographs, RAY_GRADIENT_COLUMNS};
use burn::tensor::Device;
use dvr_render::SlopeRule;
use rayon::prelude::*;

use super::rays::{LossSums, compared};
use super::{COLOR_REST, GridStates, StepBackend, StepInput, StepSums};
use crate::clock::Part;
use crate::config::GridConfig;
use crate::error::{Error, Result};
use crate::multires::MultiResGrid;
use crate::trainer::READ_EVERY;
use crate::views::{TrainingView, mix};

/// The words that say that there is nothing to compare with.
const NO_VIEW: u32 = u32::MAX;

/// The kernels and their memory.
pub(crate) struct GpuBackend {
    trainer: GpuStep,
    /// Rays that are on the device: the first, and one past the last.
    drawn: [u64; 2],
}

impl GpuBackend {
    /// Brings the photographs to the device.
    ///
    /// # Errors
    /// When it is no graphics processor, or there is no room for them.
    pub fn new(device: &Device, views: &[TrainingView], config: &GridConfig) -> Result<Self> {
        let mut photographs = Photographs::default();
        for view in views {
            photographs.views.push(view.photograph());
            photographs.pixels.extend(view.packed_pixels());
        }
        if config.losses.depth > 0.0 {
            photographs.z_depths.extend(views.iter().flat_map(TrainingView::z_depths));
        }
        let trainer = GpuStep::new(device, &photographs, weights(config)).map_err(failed)?;
        Ok(Self { trainer, drawn: [0; 2] })
    }

    /// Brings the rays of this step and some more to the device; returns where among them this step's begin.
    fn draw(&mut self, job: &StepInput) -> Result<usize> {
        let (rays, from) = (job.config.rays as u64, job.rays_drawn);
        if from < self.drawn[0] || from + rays > self.drawn[1] {
            self.drawn = [from, from + rays * READ_EVERY as u64];
            let (seed, others) = (job.config.seed, job.config.compared_views);
            let picks = (from..self.drawn[1]).into_par_iter().flat_map_iter(|count| {
                let (view, pixel) = job.order.pick(count, seed);
                let neighbours = &job.views[view as usize].neighbours;
                let others =
                    compared(neighbours, others, mix(seed ^ mix(count))).chain(std::iter::repeat(NO_VIEW)).take(others);
                [view, pixel].into_iter().chain(others)
            });
            self.trainer.draw(picks.collect(), others).map_err(failed)?;
        }
        Ok((from - self.drawn[0]) as usize)
    }

    /// The last step's ray_gradients and gradients, for tests.
    #[cfg(test)]
    pub fn trainer(&self) -> &GpuStep {
        &self.trainer
    }
}

impl StepBackend for GpuBackend {
    fn enter(&mut self, shape: &MultiResGrid<1>, color: &MultiResGrid<3>) -> Result<()> {
        let half_extent = shape.grid().half_extent();
        self.trainer.enter(half_extent, given(shape), given(color)).map_err(failed)
    }

    fn step(
        &mut self,
        job: StepInput,
        shape: &mut MultiResGrid<1>,
        color: &mut MultiResGrid<3>,
    ) -> Result<Option<StepSums>> {
        let mut start = Instant::now();
        let first = self.draw(&job)?;
        let shape_rates: Vec<f32> = (0..=shape.coarser()).map(|level| job.shape_rate(level)).collect();
        let color_rates: Vec<f32> = (0..=color.coarser()).map(|level| job.color_rate(level)).collect();
        let step = GpuStepInput {
            first,
            rays: job.config.rays,
            rates: [&shape_rates, &color_rates],
            smoothness: job.smoothness_weight(),
            rest: (job.mean_color, COLOR_REST),
        };
        self.trainer.step(&step).map_err(failed)?;
        let sums = match job.is_reported {
            true => Some(self.trainer.sums().map_err(failed)?),
            false => None,
        };
        // The device does not tell its parts apart.
        job.times.lap(Part::Rays, &mut start);
        Ok(sums.map(|sums| StepSums {
            rays: summed(&sums.ray_gradients),
            smoothness: if job.config.losses.smoothness > 0.0 { sums.smoothness } else { 0.0 },
        }))
    }

    fn levels(&self) -> Result<Option<GridStates>> {
        let [shape, color] = self.trainer.states().map_err(failed)?;
        Ok(Some((shape, color)))
    }
}

/// MultiResGrid as the device takes them up.
fn given<const C: usize>(levels: &MultiResGrid<C>) -> GpuLevels {
    let node_sets = levels.node_sets().map(|set| (set.grid().nodes(), set.iter().map(|node| node as u32).collect()));
    let base = levels.active().iter().flat_map(|node| &levels.base()[C * node..C * (node + 1)]).copied().collect();
    GpuLevels { levels: node_sets.collect(), state: levels.state(), base, values: levels.values().to_vec() }
}

fn weights(config: &GridConfig) -> GpuLosses {
    let losses = &config.losses;
    let grazing = match SlopeRule::default() {
        SlopeRule::ScaleFree { epsilon } | SlopeRule::Classic { epsilon } => epsilon as f32,
    };
    GpuLosses {
        color: losses.color as f32,
        texture: losses.texture as f32,
        photo_consistency: losses.photo_consistency as f32,
        photo_consistency_limit: losses.photo_consistency_limit as f32,
        patch_ncc: losses.patch_ncc as f32,
        patch_ncc_min: losses.patch_ncc_min as f32,
        patch_stride: losses.patch_stride,
        depth: losses.depth as f32,
        mask: losses.mask as f32,
        sharpness: losses.sharpness as f32,
        smoothness_knee: losses.smoothness_knee as f32,
        grazing,
    }
}

/// Sums over the rays' ray_gradients.
fn summed(ray_gradients: &[f32]) -> LossSums {
    let mut sums = LossSums::default();
    for ray_gradient in ray_gradients.as_chunks::<RAY_GRADIENT_COLUMNS>().0 {
        let [color, photo_consistency, patch_ncc, depth, mask] = [7, 8, 9, 10, 11].map(|i| f64::from(ray_gradient[i]));
        let [intersection, union] = [12, 13].map(|i| usize::from(ray_gradient[i] > 0.0));
        sums.add(&LossSums { color, photo_consistency, patch_ncc, depth, mask, intersection, union });
    }
    sums
}

/// What to do where a device cannot.
fn failed(problem: dvr_gpu::DeviceError) -> Error {
    Error::Device(problem)
}

#[cfg(test)]
#[path = "device_tests.rs"]
mod tests;
