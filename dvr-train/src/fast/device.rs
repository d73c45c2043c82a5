//! Steps on a graphics processor, on which everything stays that is learned.
//!
//! A step is given its rays (which pixels, which views to compare with: the same as on the processor), drawn for some
//! steps at once. It is waited for where its losses are asked for, and where the levels are.

use std::time::Instant;

use burn::tensor::Device;
use dvr_gpu::{FastError, LESSON_COLUMNS, LatticeLevels, LatticeLosses, LatticeStep, LatticeTrainer, Photographs};
use dvr_render::SlopeRule;
use rayon::prelude::*;

use super::clock::Part;
use super::config::FastConfig;
use super::levels::Levels;
use super::rays::{Tally, compared};
use super::stepper::{COLOR_REST, LevelStates, StepJob, StepSums, Stepper};
use super::views::{FastView, mix};
use crate::error::{Error, Result};
use crate::trainer::READ_EVERY;

/// The words that say that there is nothing to compare with.
const NO_VIEW: u32 = u32::MAX;

/// The kernels and their memory.
pub(super) struct DeviceStepper {
    trainer: LatticeTrainer,
    /// Rays that are on the device: the first, and one past the last.
    drawn: [u64; 2],
}

impl DeviceStepper {
    /// Brings the photographs to the device.
    ///
    /// # Errors
    /// When it is no graphics processor, or there is no room for them.
    pub fn new(device: &Device, views: &[FastView], config: &FastConfig) -> Result<Self> {
        let mut photographs = Photographs::default();
        for view in views {
            photographs.views.push(view.photograph());
            photographs.pixels.extend(view.packed_pixels());
        }
        if config.losses.depth > 0.0 {
            photographs.z_depths.extend(views.iter().flat_map(FastView::z_depths));
        }
        let trainer = LatticeTrainer::new(device, &photographs, weights(config)).map_err(failed)?;
        Ok(Self { trainer, drawn: [0; 2] })
    }

    /// Brings the rays of this step and some more to the device; returns where among them this step's begin.
    fn draw(&mut self, job: &StepJob) -> Result<usize> {
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

    /// The last step's lessons and gradients, for tests.
    #[cfg(test)]
    pub fn trainer(&self) -> &LatticeTrainer {
        &self.trainer
    }
}

impl Stepper for DeviceStepper {
    fn enter(&mut self, shape: &Levels<1>, color: &Levels<3>) -> Result<()> {
        let half_extent = shape.lattice().half_extent();
        self.trainer.enter(half_extent, given(shape), given(color)).map_err(failed)
    }

    fn step(&mut self, job: StepJob, shape: &mut Levels<1>, color: &mut Levels<3>) -> Result<Option<StepSums>> {
        let mut start = Instant::now();
        let first = self.draw(&job)?;
        let shape_rates: Vec<f32> = (0..=shape.coarser()).map(|level| job.shape_rate(level)).collect();
        let color_rates: Vec<f32> = (0..=color.coarser()).map(|level| job.color_rate(level)).collect();
        let step = LatticeStep {
            first,
            rays: job.config.rays,
            rates: [&shape_rates, &color_rates],
            roughness: job.roughness_weight(),
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
            tally: tally(&sums.lessons),
            roughness: if job.config.losses.roughness > 0.0 { sums.roughness } else { 0.0 },
        }))
    }

    fn levels(&self) -> Result<Option<LevelStates>> {
        let [shape, color] = self.trainer.states().map_err(failed)?;
        Ok(Some((shape, color)))
    }
}

/// Levels as the device takes them up.
fn given<const C: usize>(levels: &Levels<C>) -> LatticeLevels {
    let node_sets = levels.node_sets().map(|set| (set.lattice().nodes(), set.iter().map(|node| node as u32).collect()));
    let base = levels.active().iter().flat_map(|node| &levels.base()[C * node..C * (node + 1)]).copied().collect();
    LatticeLevels { levels: node_sets.collect(), state: levels.state(), base, values: levels.baked().to_vec() }
}

fn weights(config: &FastConfig) -> LatticeLosses {
    let losses = &config.losses;
    let grazing = match SlopeRule::default() {
        SlopeRule::ScaleFree { epsilon } | SlopeRule::Classic { epsilon } => epsilon as f32,
    };
    LatticeLosses {
        color: losses.color as f32,
        texture: losses.texture as f32,
        cross_view: losses.cross_view as f32,
        cross_view_limit: losses.cross_view_limit as f32,
        structure: losses.structure as f32,
        structure_limit: losses.structure_limit as f32,
        structure_stride: losses.structure_stride,
        depth: losses.depth as f32,
        mask: losses.mask as f32,
        sharpness: losses.sharpness as f32,
        roughness_knee: losses.roughness_knee as f32,
        grazing,
    }
}

/// Sums over the rays' lessons.
fn tally(lessons: &[f32]) -> Tally {
    let mut tally = Tally::default();
    for lesson in lessons.as_chunks::<LESSON_COLUMNS>().0 {
        let [color, cross_view, structure, depth, mask] = [7, 8, 9, 10, 11].map(|i| f64::from(lesson[i]));
        let [intersection, union] = [12, 13].map(|i| usize::from(lesson[i] > 0.0));
        tally.add(&Tally { color, cross_view, structure, depth, mask, intersection, union });
    }
    tally
}

/// What to do where a device cannot.
fn failed(problem: FastError) -> Error {
    crate::device::refused(problem, "--downscale and a lower --capacity take less")
}

#[cfg(test)]
#[path = "device_tests.rs"]
mod tests;
