//! How a radiance field is learned from photographs: by colours of pixels alone, from coarse to fine (Sun, Sun and Chen,
//! *Direct Voxel Grid Optimization*, 2022), with Adam's steps (Kingma and Ba 2015) where a step's rays pass.

use std::mem::size_of;

use dvr_core::{Cancellation, Cancelled};
use glam::Vec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::contracted_grid::ContractedGrid;
use super::field::{BLOCK, CHANNELS, Gradient, RadianceField, Values};
use crate::shrunk::Shrunk;

/// Nodes along an edge of the grid, level by level.
pub(crate) const LEVELS: [usize; 3] = [49, 97, 145];

/// Steps on each level, and rays of each at most.
const STEPS: usize = 400;
const RAYS: usize = 4096;

/// How often a pixel is drawn at most, in all steps together and on average: few pixels need fewer rays.
const DRAWS: usize = 8;

/// Parts of a step's rays, summed in their order: numbers do not depend on how many threads there are.
const PARTS: usize = 4;

/// What everything is at first: thin and grey.
const START: Values = [-4.0, 0.5, 0.5, 0.5];

/// Step sizes of opacity (its logit) and colour at first, and what is left of them in the end.
const RATES: Values = [0.08, 0.016, 0.016, 0.016];
const LAST_RATE: f32 = 0.1;

/// Adam's memory of gradients and of their squares.
const MOMENTS: [f32; 2] = [0.9, 0.99];

/// From this difference of colours on a pixel's pull grows no more: reflections.
const REFLECTING: f32 = 0.2;

/// Cells of less opacity are left out; how often that is looked at, and from which step of the first level on.
const EMPTY: f32 = 0.02;
const LOOK_EVERY: usize = 100;
const FIRST_LOOK: usize = 150;

/// Nodes that one thread changes at a time.
const CHUNK: usize = 1 << 14;

/// Bytes of all nodes: numbers, moments, gradients, and what is known of them.
pub(super) const BYTES: u64 =
    (ContractedGrid::new(LEVELS[LEVELS.len() - 1]).len() * (size_of::<Values>() * (3 + PARTS) + 3)) as u64;

/// A field that learns.
pub(crate) struct Fit<'a> {
    views: Vec<&'a Shrunk>,
    /// Pixels that show nothing of the object's space, where all pictures have the same size.
    ignored: &'a [bool],
    rng: ChaCha8Rng,
    level: usize,
    field: RadianceField,
}

impl<'a> Fit<'a> {
    /// Nothing is learned yet. `ignored` pixels, in all views, are left out; it may be empty.
    pub fn new(views: Vec<&'a Shrunk>, ignored: &'a [bool]) -> Self {
        let field = RadianceField::constant(ContractedGrid::new(LEVELS[0]), START, &views);
        Self { views, ignored, rng: ChaCha8Rng::seed_from_u64(0), level: 0, field }
    }

    /// What is learned by now.
    pub(super) fn field(&self) -> &RadianceField {
        &self.field
    }

    /// Learns on the next of [`LEVELS`].
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn learn(&mut self, cancellation: &Cancellation) -> Result<(), Cancelled> {
        let grid = ContractedGrid::new(LEVELS[self.level]);
        if self.level > 0 {
            self.field = self.field.on(grid, &self.views);
            self.field.skip_empty(EMPTY);
        }
        let mut moments = [vec![[0.0; CHANNELS]; grid.len()], vec![[0.0; CHANNELS]; grid.len()]];
        let mut parts: Vec<Gradient> = (0..PARTS).map(|_| Gradient::zero(grid.len())).collect();
        for step in 0..STEPS {
            cancellation.check()?;
            let done = (self.level * STEPS + step) as f32 / (LEVELS.len() * STEPS) as f32;
            let rays = self.draw();
            let of_part = rays.len().div_ceil(PARTS).max(1);
            (parts.par_iter_mut().zip(rays.par_chunks(of_part))).for_each(|(part, rays)| self.pull(rays, part));
            let rates = RATES.map(|rate| rate * LAST_RATE.powf(done));
            change(&mut self.field.values, &mut moments, &mut parts, 1.0 / rays.len().max(1) as f32, rates);
            if step % LOOK_EVERY == LOOK_EVERY - 1 && (self.level > 0 || step >= FIRST_LOOK) {
                self.field.skip_empty(EMPTY);
            }
        }
        self.level += 1;
        Ok(())
    }

    /// Pixels of a step.
    fn draw(&mut self) -> Vec<Drawn> {
        let pixels: usize = self.views.iter().map(|view| view.len()).sum();
        let rays = RAYS.min(DRAWS * pixels / (STEPS * LEVELS.len()));
        let one = |_| {
            let view = self.rng.random_range(0..self.views.len());
            let pixel = self.rng.random_range(0..self.views[view].len());
            Drawn { view, pixel, jitter: self.rng.random() }
        };
        let is_used = |drawn: &Drawn| self.ignored.get(drawn.pixel).is_none_or(|ignored| !ignored);
        (0..rays).map(one).filter(is_used).collect()
    }

    /// Sums the gradients of some pixels.
    fn pull(&self, rays: &[Drawn], gradient: &mut Gradient) {
        let mut lit = Vec::new();
        for &Drawn { view, pixel, jitter } in rays {
            let view = self.views[view];
            let direction = view.camera.direction_through(view.middle(pixel)).normalize();
            let wanted = Vec3::from(view.colors[pixel].map(f32::from)) / 255.0;
            let slope = |seen: Vec3| {
                let miss = seen - wanted;
                2.0 * miss / (1.0 + miss.length() / REFLECTING)
            };
            self.field.differentiate(view.camera.center, direction, jitter, slope, &mut lit, gradient);
        }
    }
}

/// A pixel that was drawn.
struct Drawn {
    view: usize,
    pixel: usize,
    jitter: f32,
}

/// Adam's step where there is a gradient, `scale` times the sum of its parts, which are 0 afterwards.
fn change(
    values: &mut [Values],
    [first, second]: &mut [Vec<Values>; 2],
    parts: &mut [Gradient],
    scale: f32,
    rates: Values,
) {
    let mut chunks: Vec<Vec<(&mut [Values], &mut [bool])>> =
        (0..values.len().div_ceil(CHUNK)).map(|_| Vec::new()).collect();
    for part in parts {
        let of_part = part.values.chunks_mut(CHUNK).zip(part.is_touched.chunks_mut(CHUNK / BLOCK));
        chunks.iter_mut().zip(of_part).for_each(|(chunk, of_part)| chunk.push(of_part));
    }
    let moments = first.par_chunks_mut(CHUNK).zip(second.par_chunks_mut(CHUNK));
    values.par_chunks_mut(CHUNK).zip(moments).zip(chunks).for_each(|((values, (first, second)), mut parts)| {
        for block in 0..values.len().div_ceil(BLOCK) {
            let nodes = BLOCK * block..(BLOCK * (block + 1)).min(values.len());
            let mut sums: Option<[Values; BLOCK]> = None;
            for (gradient, is_touched) in &mut parts {
                if std::mem::take(&mut is_touched[block]) {
                    let sums = sums.get_or_insert([[0.0; CHANNELS]; BLOCK]);
                    for (sum, gradient) in sums.iter_mut().zip(&mut gradient[nodes.clone()]) {
                        sum.iter_mut().zip(std::mem::take(gradient)).for_each(|(sum, by)| *sum += by);
                    }
                }
            }
            for (gradient, node) in sums.into_iter().flatten().zip(nodes) {
                if gradient == [0.0; CHANNELS] {
                    continue;
                }
                for channel in 0..CHANNELS {
                    let by = scale * gradient[channel];
                    let (first, second) = (&mut first[node][channel], &mut second[node][channel]);
                    *first = MOMENTS[0] * *first + (1.0 - MOMENTS[0]) * by;
                    *second = MOMENTS[1] * *second + (1.0 - MOMENTS[1]) * by * by;
                    values[node][channel] -= rates[channel] * *first / (second.sqrt() + 1e-10);
                }
            }
        }
    });
}
