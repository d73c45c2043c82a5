//! Steps on a GPU, on which everything stays that is learned.
//!
//! A step is given its rays (which pixels, which views to compare with: the same as on the CPU), drawn for some steps at
//! once. It is waited for where its losses are asked for, and where the grids are.

use std::borrow::Cow;
use std::ops::Range;
use std::time::Instant;

use burn::tensor::Device;
use rayon::prelude::*;

use super::kernels::{Kernels, Photographs};
use crate::bricks::BrickValues;
use crate::clock::Part;
use crate::color_trust::{Agreement, asked};
use crate::config::GridConfig;
use crate::error::{Error, Result};
use crate::gpu::launch::NONE;
use crate::losses::LossSums;
use crate::multires::Grids;
use crate::pixel_order::PixelOrder;
use crate::step::backend::{REPORT_EVERY, StepBackend, StepInput};
use crate::step::draw::{compared, draw};
use crate::views::TrainingView;

/// The kernels and their memory.
pub(crate) struct GpuBackend {
    kernels: Kernels,
    /// The grids as they were brought: their nodes are those on the device, their values are not.
    uploaded: Grids,
    /// Whether depth maps are learned from.
    has_depth: bool,
    /// Rays that are on the device: the first, and one past the last.
    drawn: [u64; 2],
}

impl GpuBackend {
    /// Brings photographs and grids to the device.
    ///
    /// # Errors
    /// When it is no GPU, or there is no room for them.
    pub fn new(device: &Device, views: &[TrainingView], config: &GridConfig, grids: Grids) -> Result<Self> {
        let has_depth = config.losses.depth.weight > 0.0;
        let mut kernels = Kernels::new(device, photographs(views, has_depth))?;
        kernels.upload(&grids)?;
        Ok(Self { kernels, uploaded: grids, has_depth, drawn: [0; 2] })
    }

    /// Brings the rays of this step and some more to the device; returns where among them this step's begin.
    fn draw(&mut self, input: &StepInput) -> Result<usize> {
        let (rays, from) = (input.config.rays as u64, input.rays_drawn);
        if from < self.drawn[0] || from + rays > self.drawn[1] {
            self.drawn = [from, from + rays * REPORT_EVERY as u64];
            let picks = picks(input.order, input.views, input.config, self.drawn[0]..self.drawn[1]);
            self.kernels.draw(picks, input.config.compared_views)?;
        }
        Ok((from - self.drawn[0]) as usize)
    }

    /// The kernels, for tests.
    #[cfg(test)]
    pub fn kernels(&self) -> &Kernels {
        &self.kernels
    }

    /// The same to change.
    #[cfg(test)]
    pub fn kernels_mut(&mut self) -> &mut Kernels {
        &mut self.kernels
    }
}

impl StepBackend for GpuBackend {
    fn upload(&mut self, grids: Grids) -> Result<()> {
        self.kernels.upload(&grids)?;
        self.uploaded = grids;
        Ok(())
    }

    fn expose(&mut self, views: &[TrainingView]) -> Result<()> {
        Ok(self.kernels.expose(views.iter().map(TrainingView::record).collect())?)
    }

    fn show(&mut self, views: &[TrainingView]) -> Result<()> {
        // Rays that were drawn are of the photographs before.
        self.drawn = [0; 2];
        Ok(self.kernels.show(photographs(views, self.has_depth))?)
    }

    fn step(&mut self, input: StepInput) -> Result<Option<LossSums>> {
        let mut start = Instant::now();
        let first = self.draw(&input)?;
        self.kernels.step(&input, first)?;
        let sums = input.is_reported.then(|| self.kernels.sums()).transpose()?;
        // The device does not tell its parts apart.
        input.times.lap(Part::Rays, &mut start);
        Ok(sums)
    }

    fn grids(&self) -> Result<Cow<'_, Grids>> {
        let [shape, color] = self.kernels.states()?;
        let mut grids = self.uploaded.clone();
        match grids.shape.restore(&shape) && grids.color.restore(&color) {
            true => Ok(Cow::Owned(grids)),
            false => Err(Error::State("the device holds other grids".into())),
        }
    }

    fn shape_values(&self) -> Result<Cow<'_, BrickValues<1>>> {
        let shape = &self.uploaded.shape;
        Ok(Cow::Owned(shape.values().with_active(shape.active(), &self.kernels.shape_values()?)))
    }

    fn agreement(
        &self,
        views: &[TrainingView],
        order: &PixelOrder,
        config: &GridConfig,
        rays_drawn: u64,
    ) -> Result<Agreement> {
        let picks = picks(order, views, config, asked(rays_drawn));
        Ok(Agreement::of(self.kernels.differences(picks, config.compared_views)?))
    }

    fn parameters(&self) -> usize {
        self.uploaded.parameters()
    }
}

/// Rays with these numbers, as kernels read them: view, pixel, other views to compare with.
fn picks(order: &PixelOrder, views: &[TrainingView], config: &GridConfig, rays: Range<u64>) -> Vec<u32> {
    let count = config.compared_views;
    let pick = |ray| {
        let drawn = draw(order, config.seed, ray);
        let neighbours = &views[drawn.view as usize].neighbours;
        let others = compared(neighbours, count, drawn.seed).chain(std::iter::repeat(NONE)).take(count);
        [drawn.view, drawn.pixel].into_iter().chain(others)
    };
    rays.into_par_iter().flat_map_iter(pick).collect()
}

/// Views as kernels read them.
fn photographs(views: &[TrainingView], has_depth: bool) -> Photographs {
    let mut photographs = Photographs::default();
    for view in views {
        photographs.views.push(view.record());
    }
    photographs.pixels = views.par_iter().flat_map_iter(TrainingView::packed_pixels).collect();
    if has_depth {
        photographs.z_depths.extend(views.iter().flat_map(TrainingView::z_depths));
    }
    photographs
}
