//! Steps on this processor.

use std::time::Instant;

use crate::active::ActiveNodes;
use crate::occupancy::OccupancyBitmask;
use crate::smoothness::LaplacianSmoothness;
use rayon::prelude::*;

use super::gather::{gather_color, gather_shape};
use super::rays::{LossSums, RayGradient, Scene};
use super::{COLOR_REST, GridStates, StepBackend, StepInput, StepSums};
use crate::clock::Part;
use crate::error::Result;
use crate::multires::MultiResGrid;
use crate::views::mix;

/// Rays that a task follows.
const CHUNK: usize = 64;

/// What follows from the levels, and is brought up to date with them.
pub(crate) struct CpuBackend {
    shape_active: Vec<bool>,
    color_active: Vec<bool>,
    map: OccupancyBitmask,
    smoothness: LaplacianSmoothness,
}

impl CpuBackend {
    pub fn new(shape: &MultiResGrid<1>, color: &MultiResGrid<3>) -> Self {
        Self {
            shape_active: membership(shape.active()),
            color_active: membership(color.active()),
            map: OccupancyBitmask::new(shape.grid(), shape.values()),
            smoothness: LaplacianSmoothness::default(),
        }
    }

    /// Field and pictures as rays see them.
    pub fn scene<'a>(
        &'a self,
        job: &StepInput<'a>,
        shape: &'a MultiResGrid<1>,
        color: &'a MultiResGrid<3>,
    ) -> Scene<'a> {
        Scene {
            views: job.views,
            shape: shape.grid(),
            values: shape.values(),
            active: &self.shape_active,
            map: &self.map,
            colors: color.grid(),
            color_values: color.values(),
            losses: &job.config.losses,
            compared_views: job.config.compared_views,
        }
    }

    /// Follows the rays of one step.
    fn ray_gradients(
        &self,
        job: &StepInput,
        shape: &MultiResGrid<1>,
        color: &MultiResGrid<3>,
    ) -> (Vec<RayGradient>, LossSums) {
        let StepInput { config, views, order, rays_drawn, .. } = *job;
        let scene = self.scene(job, shape, color);
        let seed = config.seed;
        let chunks: Vec<(Vec<RayGradient>, LossSums)> = (0..config.rays.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut sums = LossSums::default();
                let ray_gradients = (chunk * CHUNK..((chunk + 1) * CHUNK).min(config.rays))
                    .filter_map(|ray| {
                        let count = rays_drawn + ray as u64;
                        let (view, index) = order.pick(count, seed);
                        let pixel = views[view as usize].pixel_ray(view, index);
                        scene.ray_gradient(&pixel, mix(seed ^ mix(count)), &mut sums)
                    })
                    .collect();
                (ray_gradients, sums)
            })
            .collect();
        let mut total = LossSums::default();
        chunks.iter().for_each(|(_, sums)| total.add(sums));
        (chunks.into_iter().flat_map(|(ray_gradients, _)| ray_gradients).collect(), total)
    }

    fn follow_rays(&mut self, job: StepInput, shape: &mut MultiResGrid<1>, color: &mut MultiResGrid<3>) -> StepSums {
        let mut start = Instant::now();
        let (ray_gradients, sums) = self.ray_gradients(&job, shape, color);
        job.times.lap(Part::Rays, &mut start);
        let (_, gradient, active) = color.values_and_gradient_mut();
        gather_color(&ray_gradients, active, &self.color_active, gradient);
        let (values, gradient, active) = shape.values_and_gradient_mut();
        gather_shape(&ray_gradients, active, &self.shape_active, gradient);
        job.times.lap(Part::Gather, &mut start);
        let losses = &job.config.losses;
        let mut smoothness = 0.0;
        if losses.smoothness > 0.0 {
            let (weight, knee) = (job.smoothness_weight(), losses.smoothness_knee as f32);
            smoothness = self.smoothness.add_gradient(values, gradient, active, weight, knee);
        }
        job.times.lap(Part::LaplacianSmoothness, &mut start);
        color.pull_towards(job.mean_color, COLOR_REST);
        shape.step(|level| job.shape_rate(level));
        color.step(|level| job.color_rate(level));
        job.times.lap(Part::MultiResGrid, &mut start);
        self.map.update(shape.values(), shape.active());
        job.times.lap(Part::OccupancyBitmask, &mut start);
        StepSums { rays: sums, smoothness }
    }
}

impl StepBackend for CpuBackend {
    fn enter(&mut self, shape: &MultiResGrid<1>, color: &MultiResGrid<3>) -> Result<()> {
        *self = Self::new(shape, color);
        Ok(())
    }

    fn step(
        &mut self,
        job: StepInput,
        shape: &mut MultiResGrid<1>,
        color: &mut MultiResGrid<3>,
    ) -> Result<Option<StepSums>> {
        // In the pool as a whole: entering it costs more than many of the loops inside.
        Ok(Some(rayon::scope(|_| self.follow_rays(job, shape, color))))
    }

    fn levels(&self) -> Result<Option<GridStates>> {
        Ok(None)
    }
}

/// Whether each node of the grid is in the set.
fn membership(active: &ActiveNodes) -> Vec<bool> {
    let mut member = vec![false; active.grid().len()];
    active.iter().for_each(|node| member[node] = true);
    member
}
