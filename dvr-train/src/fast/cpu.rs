//! Steps on this processor.

use std::time::Instant;

use dvr_kernels::{ActiveNodes, Roughness, SignMap};
use rayon::prelude::*;

use super::clock::Part;
use super::levels::Levels;
use super::rays::{Lesson, Scene, Tally};
use super::scatter::{gather_color, gather_shape};
use super::stepper::{COLOR_REST, LevelStates, StepJob, StepSums, Stepper};
use super::views::mix;
use crate::error::Result;

/// Rays that a task follows.
const CHUNK: usize = 64;

/// What follows from the levels, and is brought up to date with them.
pub(super) struct CpuStepper {
    shape_active: Vec<bool>,
    color_active: Vec<bool>,
    map: SignMap,
    roughness: Roughness,
}

impl CpuStepper {
    pub fn new(shape: &Levels<1>, color: &Levels<3>) -> Self {
        Self {
            shape_active: membership(shape.active()),
            color_active: membership(color.active()),
            map: SignMap::new(shape.lattice(), shape.baked()),
            roughness: Roughness::default(),
        }
    }

    /// Field and pictures as rays see them.
    pub fn scene<'a>(&'a self, job: &StepJob<'a>, shape: &'a Levels<1>, color: &'a Levels<3>) -> Scene<'a> {
        Scene {
            views: job.views,
            shape: shape.lattice(),
            values: shape.baked(),
            active: &self.shape_active,
            map: &self.map,
            colors: color.lattice(),
            color_values: color.baked(),
            losses: &job.config.losses,
            compared_views: job.config.compared_views,
        }
    }

    /// Follows the rays of one step.
    fn lessons(&self, job: &StepJob, shape: &Levels<1>, color: &Levels<3>) -> (Vec<Lesson>, Tally) {
        let StepJob { config, views, order, rays_drawn, .. } = *job;
        let scene = self.scene(job, shape, color);
        let seed = config.seed;
        let chunks: Vec<(Vec<Lesson>, Tally)> = (0..config.rays.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut tally = Tally::default();
                let lessons = (chunk * CHUNK..((chunk + 1) * CHUNK).min(config.rays))
                    .filter_map(|ray| {
                        let count = rays_drawn + ray as u64;
                        let (view, index) = order.pick(count, seed);
                        let pixel = views[view as usize].pixel_ray(view, index);
                        scene.lesson(&pixel, mix(seed ^ mix(count)), &mut tally)
                    })
                    .collect();
                (lessons, tally)
            })
            .collect();
        let mut total = Tally::default();
        chunks.iter().for_each(|(_, tally)| total.add(tally));
        (chunks.into_iter().flat_map(|(lessons, _)| lessons).collect(), total)
    }

    fn follow_rays(&mut self, job: StepJob, shape: &mut Levels<1>, color: &mut Levels<3>) -> StepSums {
        let mut start = Instant::now();
        let (lessons, tally) = self.lessons(&job, shape, color);
        job.times.lap(Part::Rays, &mut start);
        let (_, gradient, active) = color.values_and_gradient_mut();
        gather_color(&lessons, active, &self.color_active, gradient);
        let (values, gradient, active) = shape.values_and_gradient_mut();
        gather_shape(&lessons, active, &self.shape_active, gradient);
        job.times.lap(Part::Gather, &mut start);
        let losses = &job.config.losses;
        let mut roughness = 0.0;
        if losses.roughness > 0.0 {
            let (weight, knee) = (job.roughness_weight(), losses.roughness_knee as f32);
            roughness = self.roughness.add_gradient(values, gradient, active, weight, knee);
        }
        job.times.lap(Part::Roughness, &mut start);
        color.pull_towards(job.mean_color, COLOR_REST);
        shape.step(|level| job.shape_rate(level));
        color.step(|level| job.color_rate(level));
        job.times.lap(Part::Levels, &mut start);
        self.map.update(shape.baked(), shape.active());
        job.times.lap(Part::SignMap, &mut start);
        StepSums { tally, roughness }
    }
}

impl Stepper for CpuStepper {
    fn enter(&mut self, shape: &Levels<1>, color: &Levels<3>) -> Result<()> {
        *self = Self::new(shape, color);
        Ok(())
    }

    fn step(&mut self, job: StepJob, shape: &mut Levels<1>, color: &mut Levels<3>) -> Result<Option<StepSums>> {
        // In the pool as a whole: entering it costs more than many of the loops inside.
        Ok(Some(rayon::scope(|_| self.follow_rays(job, shape, color))))
    }

    fn levels(&self) -> Result<Option<LevelStates>> {
        Ok(None)
    }
}

/// Whether each node of the lattice is in the set.
fn membership(active: &ActiveNodes) -> Vec<bool> {
    let mut member = vec![false; active.lattice().len()];
    active.iter().for_each(|node| member[node] = true);
    member
}
