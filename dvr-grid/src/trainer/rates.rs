//! How fast the two things go that a step on photographs spends most on, each alone on one thread.

use std::time::{Duration, Instant};

use super::GridTrainer;
use crate::bricks::BrickOccupancy;
use crate::error::Result;
use crate::plane_patch::{PlanePatch, SAMPLES};
use crate::step::draw::draw_step;
use crate::surface::Surface;
use crate::views::PixelRay;

/// What one thread does in a second; zero where there was nothing to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Rays of drawn pixels that are followed until they meet the surface, exactly, or leave.
    pub crossings: f64,
    /// Samples of patches that are carried to a neighbouring photograph and compared with it.
    pub patch_samples: f64,
}

impl GridTrainer<'_> {
    /// Measures them on the field and the photographs of this stage, with the pixels of so many steps to come.
    ///
    /// # Errors
    /// When a GPU that keeps the field fails.
    pub fn rates(&self, steps: usize) -> Result<Rates> {
        let (values, views) = (self.backend.shape_values()?, &self.photographs.views);
        let occupancy = BrickOccupancy::new(&values);
        let surface = Surface::of(&values, &occupancy);
        let (mut crossings, mut patch_samples) = (Rate::default(), Rate::default());
        for step in 0..steps {
            // Those of a step lie close together in its order.
            let first = self.rays_drawn + (step * self.config.rays) as u64;
            let drawn = draw_step(&self.photographs.order, self.config.seed, first, self.config.rays, views);
            let pixels: Vec<_> =
                drawn.iter().map(|ray| views[ray.view as usize].pixel_ray(ray.view, ray.pixel)).collect();
            let depths: Vec<Option<f32>> = crossings.of(|| {
                let depth = |pixel: &PixelRay| surface.depth(views[pixel.view as usize].camera.center, pixel.direction);
                let depths: Vec<_> = pixels.iter().map(depth).collect();
                (depths.len(), depths)
            });
            let patch = |(pixel, depth): (&PixelRay, Option<f32>)| {
                let view = &views[pixel.view as usize];
                let origin = view.camera.center;
                let at = surface.at(origin + depth.filter(|_| pixel.object)? * pixel.direction);
                let stride = self.config.losses.patch_ncc.stride;
                Some((view, PlanePatch::on_plane(view, pixel.pixel, stride, origin, at.point, at.inward)?))
            };
            let patches: Vec<_> = pixels.iter().zip(depths).filter_map(patch).collect();
            patch_samples.of(|| {
                let others = patches.iter().flat_map(|(view, patch)| view.neighbours.iter().map(move |&i| (patch, i)));
                let compared = others.filter_map(|(patch, other)| patch.compare(&views[other as usize]));
                (SAMPLES * compared.count(), ())
            });
        }
        Ok(Rates { crossings: crossings.per_second(), patch_samples: patch_samples.per_second() })
    }
}

/// What was done, and how long it took.
#[derive(Default)]
struct Rate {
    count: usize,
    time: Duration,
}

impl Rate {
    /// Does something, and adds what that says it has done.
    fn of<T>(&mut self, work: impl FnOnce() -> (usize, T)) -> T {
        let clock = Instant::now();
        let (count, result) = work();
        self.time += clock.elapsed();
        self.count += count;
        result
    }

    fn per_second(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.count as f64 / self.time.as_secs_f64() }
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::View;

    use super::*;
    use crate::config::{Capacity, GridConfig};
    use crate::step::suite::speckled_arc;

    #[test]
    fn rates_are_of_work_that_is_done() {
        let views = speckled_arc(4);
        let trainer = |views: &[&'static View]| {
            let config = GridConfig { capacity: Capacity::Cells(32), steps: 1, ..GridConfig::default() };
            GridTrainer::new(views.to_vec(), Vec::new(), config).unwrap()
        };
        let views: Vec<&View> = views.leak().iter().collect();
        let Rates { crossings, patch_samples } = trainer(&views).rates(2).unwrap();
        assert!(crossings > 0.0 && patch_samples > 0.0 && crossings.is_finite() && patch_samples.is_finite());
        assert_eq!(trainer(&views[..1]).rates(2).unwrap().patch_samples, 0.0, "no other photograph");
        assert_eq!(trainer(&views).rates(0).unwrap(), Rates { crossings: 0.0, patch_samples: 0.0 });
    }
}
