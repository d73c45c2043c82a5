//! Marching through snapshots: front to back, and no further than to the surface.

use burn::tensor::{Device, Int, Tensor, TensorData};
use glam::Vec3;
use rayon::prelude::*;

use crate::field::crossing::Snapshot;
use crate::march::host_rays::HostRays;
use crate::march::marcher::{Hits, March, MarchSettings, Marcher, RayStatus};
use crate::march::rays::Rays;
use crate::march::root::Bracket;

/// Marches through gradient-free snapshots of a field, one per object: the same samples as those of
/// [`TensorMarcher`](crate::TensorMarcher), but none behind the first crossing.
///
/// Of a ray that hits or starts inside, [`March::max_logit_depth`] is that of the samples up to there.
pub struct SnapshotMarcher<'a> {
    snapshots: &'a [Snapshot],
    settings: MarchSettings,
}

/// Rays that are marched together, by one thread.
const RAYS: usize = 128;

/// Points that a round asks for, about: rays that are still on their way share them.
const POINTS: usize = 768;

/// Samples of a ray that a round asks for at least: enough rays in flight keep tiles full, few samples end in time.
const MIN_SAMPLES: usize = 4;

impl<'a> SnapshotMarcher<'a> {
    /// Marches through `snapshots`, one for each object index that rays have.
    pub fn new(snapshots: &'a [Snapshot], settings: MarchSettings) -> Self {
        Self { snapshots, settings: MarchSettings { steps: settings.steps.max(2), ..settings } }
    }

    /// Marches some rays of one object.
    fn sample(&self, rays: &HostRays, chunk: &[usize]) -> Vec<Sampled> {
        let snapshot = &self.snapshots[rays.object(chunk[0])];
        let steps = self.settings.steps;
        let mut found = vec![Sampled::default(); chunk.len()];
        let mut last = vec![f32::NAN; chunk.len()];
        let mut largest = vec![f32::NEG_INFINITY; chunk.len()];
        let mut active: Vec<usize> =
            (0..chunk.len()).filter(|&i| rays.entry[chunk[i]] <= rays.exit[chunk[i]]).collect();
        for (i, sampled) in found.iter_mut().enumerate() {
            sampled.max_logit_depth = rays.depth_of(chunk[i], 0, steps);
        }
        let (mut first, mut points) = (0, Vec::with_capacity(POINTS));
        while first < steps && !active.is_empty() {
            let count = (POINTS / active.len()).max(MIN_SAMPLES).min(steps - first);
            points.clear();
            for &i in &active {
                let ray = chunk[i];
                points.extend((first..first + count).map(|k| rays.at(ray, rays.depth_of(ray, k, steps))));
            }
            let logits = snapshot.logits(&points);
            let mut values = logits.chunks(count);
            active.retain(|&i| {
                for (k, &logit) in (first..).zip(values.next().unwrap_or_default()) {
                    if logit > largest[i] {
                        largest[i] = logit;
                        found[i].max_logit_depth = rays.depth_of(chunk[i], k, steps);
                    }
                    // A logit of exactly 0 is on the surface, hence inside; NaN is outside.
                    if logit >= 0.0 {
                        found[i].starts_inside = k == 0;
                        let depths = [k.saturating_sub(1), k].map(|k| rays.depth_of(chunk[i], k, steps));
                        found[i].bracket = (k > 0).then_some((depths, [last[i], logit]));
                        return false;
                    }
                    last[i] = logit;
                }
                true
            });
            first += count;
        }
        found
    }

    /// Logits at one point per ray.
    fn logits(&self, rays: &HostRays, indices: &[usize], points: &[Vec3]) -> Vec<f32> {
        if rays.object.is_none() {
            return self.snapshots[0].logits(points);
        }
        let mut order: Vec<usize> = (0..indices.len()).collect();
        order.sort_by_key(|&i| rays.object(indices[i]));
        let mut logits = vec![0.0; points.len()];
        for group in order.chunk_by(|&a, &b| rays.object(indices[a]) == rays.object(indices[b])) {
            let own: Vec<Vec3> = group.iter().map(|&i| points[i]).collect();
            let values = self.snapshots[rays.object(indices[group[0]])].logits(&own);
            group.iter().zip(values).for_each(|(&i, value)| logits[i] = value);
        }
        logits
    }
}

/// What sampling a ray finds.
#[derive(Clone, Copy, Debug, Default)]
struct Sampled {
    starts_inside: bool,
    max_logit_depth: f32,
    /// Depths and logits of the last sample outside and the first inside.
    bracket: Option<([f32; 2], [f32; 2])>,
}

impl Sampled {
    fn status(&self) -> RayStatus {
        match self.bracket {
            Some(_) => RayStatus::Hits,
            None if self.starts_inside => RayStatus::StartsInside,
            None => RayStatus::Misses,
        }
    }
}

impl Marcher for SnapshotMarcher<'_> {
    fn march(&self, rays: &Rays, jitter: Option<Tensor<1>>) -> March {
        let device = rays.entry.device();
        let host = HostRays::new(rays, jitter);
        let mut order: Vec<usize> = (0..rays.len()).collect();
        order.sort_by_key(|&i| host.object(i));
        let chunks: Vec<&[usize]> =
            order.chunk_by(|&a, &b| host.object(a) == host.object(b)).flat_map(|group| group.chunks(RAYS)).collect();
        let marched: Vec<Vec<Sampled>> = chunks.par_iter().map(|chunk| self.sample(&host, chunk)).collect();
        let mut sampled = vec![Sampled::default(); rays.len()];
        for (&ray, found) in order.iter().zip(marched.into_iter().flatten()) {
            sampled[ray] = found;
        }

        let brackets: Vec<_> = sampled.iter().enumerate().filter_map(|(i, s)| Some((i, s.bracket?))).collect();
        let hits = (!brackets.is_empty()).then(|| {
            let indices: Vec<usize> = brackets.iter().map(|(i, _)| *i).collect();
            let numbers = |part: fn(&([f32; 2], [f32; 2])) -> f32| {
                floats(brackets.iter().map(|(_, bracket)| part(bracket)).collect(), &device)
            };
            let bracket = Bracket {
                outside: numbers(|(depth, _)| depth[0]),
                inside: numbers(|(depth, _)| depth[1]),
                outside_logit: numbers(|(_, logit)| logit[0]),
                inside_logit: numbers(|(_, logit)| logit[1]),
            };
            let logit = |depth: Tensor<1>| {
                let points: Vec<Vec3> =
                    depth.into_data().iter::<f32>().zip(&indices).map(|(depth, &ray)| host.at(ray, depth)).collect();
                floats(self.logits(&host, &indices, &points), &device)
            };
            let depth = self.settings.root.find(bracket, self.settings.root_steps, logit);
            let index: Vec<i64> = indices.iter().map(|&i| i as i64).collect();
            let index = Tensor::<1, Int>::from_data(TensorData::new(index, [indices.len()]), &device);
            Hits { rays: rays.select(&index), index, depth }
        });
        March {
            hits,
            status: sampled.iter().map(Sampled::status).collect(),
            max_logit_depth: floats(sampled.iter().map(|s| s.max_logit_depth).collect(), &device),
        }
    }
}

/// Numbers on a device, `[n]`.
fn floats(values: Vec<f32>, device: &Device) -> Tensor<1> {
    let n = values.len();
    Tensor::from_data(TensorData::new(values, [n]), device)
}
