//! Marching through tensors, on any device.

use burn::tensor::{Int, Tensor};

use crate::chunks::{chunks, in_parallel, points_at_once};
use crate::field::query::Query;
use crate::field::sampling::Field;
use crate::march::marcher::{Hits, March, MarchSettings, Marcher, RayStatus};
use crate::march::rays::Rays;
use crate::march::root::Bracket;

/// The plain marcher: every sample of every ray goes through the field. Slow; all others are tested against it.
#[derive(Clone, Debug)]
pub struct TensorMarcher<F> {
    field: F,
    settings: MarchSettings,
}

impl<F: Field> TensorMarcher<F> {
    /// Marches through `field`, which must not track gradients (`Module::valid`).
    pub fn new(field: F, settings: MarchSettings) -> Self {
        let max_points = points_at_once(&field.device(), settings.max_points.max(1));
        let settings = MarchSettings { steps: settings.steps.max(2), max_points, ..settings };
        Self { field, settings }
    }

    /// Logits at one depth per ray, in chunks.
    fn logits_at(&self, rays: &Rays, depth: Tensor<1>) -> Tensor<1> {
        let query = rays.query_at(depth);
        let parts: Vec<_> = chunks(query.len(), self.settings.max_points).collect();
        let evaluate = |(start, length)| self.field.occupancy_logit(&query.narrow(start, length));
        Tensor::cat(in_parallel(&rays.entry.device(), parts, evaluate), 0)
    }

    /// Samples a few rays and finds the first sample inside.
    fn sample(&self, rays: &Rays, jitter: Option<Tensor<1>>) -> Samples {
        let (n, steps) = (rays.len(), self.settings.steps);
        let device = rays.entry.device();
        let index = Tensor::<1, Int>::arange(0..steps as i64, &device).float().unsqueeze_dim::<2>(0); // [1, steps]
        let share = match jitter {
            None => (index.clone() / (steps - 1) as f64).expand([n, steps]),
            Some(jitter) => (index.clone() + jitter.unsqueeze_dim(1)) / steps as f64,
        };
        let length = (rays.exit.clone() - rays.entry.clone()).unsqueeze_dim::<2>(1);
        let depth = rays.entry.clone().unsqueeze_dim::<2>(1) + length * share; // [n, steps]
        let points = rays.origin.clone().unsqueeze_dim::<3>(1)
            + rays.direction.clone().unsqueeze_dim::<3>(1) * depth.clone().unsqueeze_dim::<3>(2);
        let object = rays.object.clone().map(|o| o.unsqueeze_dim::<2>(1).expand([n, steps]).reshape([n * steps]));
        let query = Query { object, ..Query::new(points.reshape([n * steps, 3])) };
        let logit = self.field.occupancy_logit(&query).reshape([n, steps]);

        // A logit of exactly 0 is on the surface, hence inside; NaN is outside.
        let inside = logit.clone().greater_equal_elem(0.0);
        // `steps - first index inside`, or 0 where there is none: one reduction on any device.
        let rank = (inside.float() * (index.neg() + steps as f64)).max_dim(1);
        let in_cube = rays.exit.clone().greater_equal(rays.entry.clone());
        let starts_inside = rank.clone().squeeze_dim::<1>(1).equal_elem(steps as f64).bool_and(in_cube.clone());
        let hit = rank
            .clone()
            .squeeze_dim::<1>(1)
            .greater_elem(0.0)
            .bool_and(starts_inside.clone().bool_not())
            .bool_and(in_cube);
        let after = (rank.neg() + steps as f64).clamp(1.0, (steps - 1) as f64).int(); // [n, 1]
        let before = after.clone() - 1;
        let pick = |values: &Tensor<2>, at: &Tensor<2, Int>| values.clone().gather(1, at.clone()).squeeze_dim::<1>(1);
        let bracket = Bracket {
            outside: pick(&depth, &before),
            inside: pick(&depth, &after),
            outside_logit: pick(&logit, &before),
            inside_logit: pick(&logit, &after),
        };
        let max_logit_depth = pick(&depth, &logit.argmax(1));
        let status = hit.float() + starts_inside.float() * 2.0;
        Samples { status, max_logit_depth, bracket }
    }
}

/// What sampling a chunk of rays finds, one entry per ray; the bracket is meaningless where a ray does not hit.
struct Samples {
    /// [`RayStatus`]s as numbers.
    status: Tensor<1>,
    max_logit_depth: Tensor<1>,
    bracket: Bracket,
}

impl<F: Field> Marcher for TensorMarcher<F> {
    fn march(&self, rays: &Rays, jitter: Option<Tensor<1>>) -> March {
        let rays_a_chunk = (self.settings.max_points / self.settings.steps).max(1);
        let parts = chunks(rays.len(), rays_a_chunk).collect();
        let samples = in_parallel(&rays.entry.device(), parts, |(start, length)| {
            self.sample(&rays.narrow(start, length), jitter.clone().map(|j| j.narrow(0, start, length)))
        });
        let gather = |part: fn(&Samples) -> Tensor<1>| Tensor::cat(samples.iter().map(part).collect(), 0);
        let status = RayStatus::read(gather(|s| s.status.clone()));
        let max_logit_depth = gather(|s| s.max_logit_depth.clone());
        let hits = Hits::places(&status, rays).map(|index| {
            let hit_rays = rays.select(&index);
            let pick = |part: fn(&Samples) -> Tensor<1>| gather(part).select(0, index.clone());
            let bracket = Bracket {
                outside: pick(|s| s.bracket.outside.clone()),
                inside: pick(|s| s.bracket.inside.clone()),
                outside_logit: pick(|s| s.bracket.outside_logit.clone()),
                inside_logit: pick(|s| s.bracket.inside_logit.clone()),
            };
            let logit = |depth| self.logits_at(&hit_rays, depth);
            let depth = self.settings.root.find(bracket, self.settings.root_steps, logit);
            Hits { index, rays: hit_rays, depth }
        });
        March { hits, status, max_logit_depth }
    }
}
