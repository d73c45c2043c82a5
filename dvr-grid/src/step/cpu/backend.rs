//! The parts of a step on the CPU, one after the other.

use std::borrow::Cow;
use std::time::Instant;

use rayon::prelude::*;

use super::gather::{gather_color, gather_shape};
use super::rays::{RayContext, RayGradient};
use crate::bricks::{BrickOccupancy, BrickValues};
use crate::clock::Part;
use crate::color;
use crate::error::Result;
use crate::losses::LossSums;
use crate::losses::smoothness::LaplacianSmoothness;
use crate::multires::Grids;
use crate::step::backend::{COLOR_REST, StepBackend, StepInput};
use crate::step::draw::{DrawnRay, draw_step};
use crate::surface::Surface;
use crate::views::TrainingView;

/// Rays that a task follows.
const CHUNK: usize = 64;

/// The grids, and what follows from them.
pub(crate) struct CpuBackend {
    grids: Grids,
    occupancy: BrickOccupancy,
    smoothness: LaplacianSmoothness,
}

impl CpuBackend {
    pub fn new(grids: Grids) -> Self {
        Self { occupancy: BrickOccupancy::new(grids.shape.values()), smoothness: LaplacianSmoothness::default(), grids }
    }

    /// Field and photographs as rays see them.
    pub fn context<'a>(&'a self, input: &StepInput<'a>) -> RayContext<'a> {
        let Grids { shape, color } = &self.grids;
        RayContext {
            views: input.views,
            surface: Surface::of(shape.values(), &self.occupancy),
            colors: color.values(),
            losses: &input.config.losses,
            compared_views: input.config.compared_views,
            slope_rule: input.slope_rule,
        }
    }

    /// Follows the rays of one step.
    fn ray_gradients(&self, input: &StepInput) -> (Vec<RayGradient>, LossSums) {
        let (context, config) = (self.context(input), input.config);
        let drawn = draw_step(input.order, config.seed, input.rays_drawn, config.rays, input.views);
        let chunks: Vec<(Vec<RayGradient>, LossSums)> = drawn
            .par_chunks(CHUNK)
            .map(|drawn| {
                let mut sums = LossSums::default();
                let of_ray = |drawn: &DrawnRay| {
                    let pixel = input.views[drawn.view as usize].pixel_ray(drawn.view, drawn.pixel);
                    context.ray_gradient(&pixel, drawn.seed, &mut sums)
                };
                let ray_gradients = drawn.iter().filter_map(of_ray).collect();
                (ray_gradients, sums)
            })
            .collect();
        let mut total = LossSums::default();
        chunks.iter().for_each(|(_, sums)| total.add(sums));
        (chunks.into_iter().flat_map(|(ray_gradients, _)| ray_gradients).collect(), total)
    }

    fn carry_out(&mut self, input: StepInput) -> LossSums {
        let mut start = Instant::now();
        let (ray_gradients, mut sums) = self.ray_gradients(&input);
        input.times.lap(Part::Rays, &mut start);
        let Grids { shape, color } = &mut self.grids;
        let ((colors, color_gradient), (values, gradient)) =
            (color.values_and_gradient_mut(), shape.values_and_gradient_mut());
        rayon::join(
            || gather_color(&ray_gradients, colors.layout(), color_gradient),
            || gather_shape(&ray_gradients, values.layout(), gradient),
        );
        input.times.lap(Part::Gather, &mut start);
        let loss = &input.config.losses.smoothness;
        if loss.weight > 0.0 {
            let (weight, knee) = (input.smoothness_weight(), loss.knee as f32);
            sums.smoothness = self.smoothness.add_gradient(values, gradient, weight, knee).into();
        }
        input.times.lap(Part::LaplacianSmoothness, &mut start);
        color.pull_towards(color::constant(input.mean_color), COLOR_REST);
        shape.step(|level| input.shape_rate(level));
        color.step(|level| input.color_rate(level));
        input.times.lap(Part::MultiResGrid, &mut start);
        self.occupancy.update(shape.values());
        input.times.lap(Part::OccupancyBitmask, &mut start);
        sums
    }
}

impl StepBackend for CpuBackend {
    fn upload(&mut self, grids: Grids) -> Result<()> {
        *self = Self::new(grids);
        Ok(())
    }

    fn expose(&mut self, _views: &[TrainingView]) -> Result<()> {
        // Each step is given the views.
        Ok(())
    }

    fn show(&mut self, _views: &[TrainingView]) -> Result<()> {
        Ok(())
    }

    fn step(&mut self, input: StepInput) -> Result<Option<LossSums>> {
        // In the pool as a whole: entering it costs more than many of the loops inside.
        Ok(Some(rayon::scope(|_| self.carry_out(input))))
    }

    fn grids(&self) -> Result<Cow<'_, Grids>> {
        Ok(Cow::Borrowed(&self.grids))
    }

    fn shape_values(&self) -> Result<Cow<'_, BrickValues<1>>> {
        Ok(Cow::Borrowed(self.grids.shape.values()))
    }

    fn parameters(&self) -> usize {
        self.grids.parameters()
    }
}
