//! Marching a grid field: each ray meets the surface exactly, without samples.

use burn::tensor::Tensor;
use dvr_render::extract::ScalarField;
use dvr_render::{HostRays, March, MarchSettings, Marcher, RayStatus, Rays};

/// What finds exact crossings of rays with a field.
pub(super) trait ExactCrossing: ScalarField {
    /// The first crossing from outside in each ray's interval.
    fn first_crossings(&self, rays: &HostRays) -> Vec<Option<f32>>;
}

/// Answers as every marcher does; of the settings, the samples alone are used, for the depth of the largest logit on
/// rays that miss.
pub(super) struct ExactMarcher<'a, F> {
    field: &'a F,
    samples: usize,
}

impl<'a, F: ExactCrossing> ExactMarcher<'a, F> {
    pub fn new(field: &'a F, settings: MarchSettings) -> Self {
        Self { field, samples: settings.steps.max(2) }
    }

    /// Depth of the sample with the largest logit on each of some rays.
    fn max_logit_depths(&self, rays: &HostRays, of: &[usize]) -> Vec<f32> {
        let depth = |ray, sample| rays.depth_of(ray, sample, self.samples);
        let samples = of.iter().flat_map(|&ray| (0..self.samples).map(move |sample| (ray, sample)));
        let points: Vec<_> = samples.map(|(ray, sample)| rays.at(ray, depth(ray, sample))).collect();
        let logits = self.field.logits(&points);
        let largest =
            |logits: &[f32]| (1..logits.len()).fold(0, |best, i| if logits[i] > logits[best] { i } else { best });
        of.iter().zip(logits.chunks(self.samples)).map(|(&ray, logits)| depth(ray, largest(logits))).collect()
    }
}

impl<F: ExactCrossing> Marcher for ExactMarcher<'_, F> {
    fn march(&self, rays: &Rays, jitter: Option<Tensor<1>>) -> March {
        let host = HostRays::new(rays, jitter);
        let all = 0..rays.len();
        let starts: Vec<_> = all.clone().map(|ray| host.at(ray, host.entry[ray])).collect();
        let starts = self.field.logits(&starts);
        let crossings = self.field.first_crossings(&host);
        let status = |ray: usize| match crossings[ray] {
            _ if host.entry[ray] > host.exit[ray] => RayStatus::Misses,
            _ if starts[ray] >= 0.0 => RayStatus::StartsInside,
            Some(_) => RayStatus::Hits,
            None => RayStatus::Misses,
        };
        let status: Vec<RayStatus> = all.clone().map(status).collect();
        let depth: Vec<f32> = all.clone().map(|ray| crossings[ray].unwrap_or(host.entry[ray])).collect();
        let mut max_logit_depth = depth.clone();
        let missing: Vec<usize> = all.filter(|&ray| status[ray] == RayStatus::Misses).collect();
        for (&ray, depth) in missing.iter().zip(self.max_logit_depths(&host, &missing)) {
            max_logit_depth[ray] = depth;
        }
        March::of_numbers(rays, status, &depth, max_logit_depth)
    }
}
