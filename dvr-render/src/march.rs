//! Gradient-free ray marching: where does each ray first cross the surface? (DVR, section 3.2.)

use burn::tensor::{Int, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use crate::chunks::{chunks, in_parallel, points_at_once};
use crate::field::{Field, Query};
use crate::rays::Rays;
use crate::root::{Bracket, RootMethod};

/// How finely rays are searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MarchSettings {
    /// Samples on a ray, both ends of its interval included; at least 2.
    ///
    /// A sheet thinner than `interval / (steps - 1)` along the ray may be stepped over.
    pub steps: usize,
    /// How the crossing between two samples is located.
    pub root: RootMethod,
    /// Evaluations a ray that the root search spends.
    pub root_steps: usize,
    /// Points evaluated at once on a CPU: few enough for the activations to stay in cache. On a GPU, its memory says
    /// how many.
    pub max_points: usize,
}

impl Default for MarchSettings {
    fn default() -> Self {
        Self { steps: 128, root: RootMethod::default(), root_steps: 8, max_points: 8192 }
    }
}

/// Answers one question about a fixed field, without gradients: where does this ray first cross from outside to inside?
pub trait Marcher {
    /// Marches a batch of rays.
    ///
    /// `jitter`, `[n]` in `[0, 1)`, shifts the samples of each ray by that share of their distance (and then leaves the
    /// interval's ends out): training sees other samples in every step, thin parts are not missed for ever.
    fn march(&self, rays: &Rays, jitter: Option<Tensor<1>>) -> March;
}

/// What marching found.
#[derive(Clone, Debug)]
pub struct March {
    /// The rays that hit, `None` where no ray does.
    pub hits: Option<Hits>,
    /// What became of each ray, in the batch's order. Not on the device: which rays hit must be known to the program,
    /// to go on with these alone, and is read back once.
    pub status: Vec<RayStatus>,
    /// Depth of the sample with the largest logit, `[n]`: where a ray that misses came closest to the object. Of other
    /// rays, a marcher that stops at the surface has looked at the samples before it alone.
    pub max_logit_depth: Tensor<1>,
}

impl March {
    /// From what a kernel leaves on the device, `[n, 3]`: the status of each ray as a number (0 misses, 1 hits, 2 starts
    /// inside), the depth of its crossing, and that of its densest sample. The fates alone are read back.
    pub fn of_columns(rays: &Rays, columns: &Tensor<2>) -> Self {
        let column = |i| columns.clone().narrow(1, i, 1).squeeze_dim::<1>(1);
        let status = RayStatus::read(column(0));
        let hits = Hits::places(&status, rays).map(|index| Hits {
            rays: rays.select(&index),
            depth: column(1).select(0, index.clone()),
            index,
        });
        Self { hits, status, max_logit_depth: column(2) }
    }
}

/// What became of a ray.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RayStatus {
    /// It meets nothing.
    #[default]
    Misses,
    /// It meets the surface from outside.
    Hits,
    /// It starts inside the object. Such a ray hits nothing: it sees no surface from outside.
    StartsInside,
}

impl RayStatus {
    /// The fates that a marcher left on the device as numbers, `[n]`: 0, 1 and 2 in the order of the variants. Reads
    /// them back.
    fn read(codes: Tensor<1>) -> Vec<Self> {
        let status = |code: f32| match code {
            1.0 => Self::Hits,
            2.0 => Self::StartsInside,
            _ => Self::Misses,
        };
        codes.into_data().iter::<f32>().map(status).collect()
    }

    /// The places of the rays that hit, ascending.
    fn hits(fates: &[Self]) -> Vec<i64> {
        fates.iter().enumerate().filter(|(_, status)| **status == Self::Hits).map(|(i, _)| i as i64).collect()
    }
}

/// The rays of a batch that hit, and where.
#[derive(Clone, Debug)]
pub struct Hits {
    /// Their indices in the batch, ascending, `[h]`.
    pub index: Tensor<1, Int>,
    /// The rays themselves, `h` of them.
    pub rays: Rays,
    /// Ray depth of the crossing, `[h]`.
    pub depth: Tensor<1>,
}

impl Hits {
    /// The places of the rays that hit, on the rays' device; `None` where none does.
    fn places(fates: &[RayStatus], rays: &Rays) -> Option<Tensor<1, Int>> {
        let places = RayStatus::hits(fates);
        let count = places.len();
        (count > 0).then(|| Tensor::from_data(TensorData::new(places, [count]), &rays.entry.device()))
    }

    /// How many rays hit.
    pub fn len(&self) -> usize {
        self.depth.dims()[0]
    }

    /// Always false: a march without hits has no [`Hits`].
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The crossings, `[h, 3]`.
    pub fn points(&self) -> Tensor<2> {
        self.rays.at(self.depth.clone())
    }

    /// The crossings as a query.
    pub fn query(&self) -> Query {
        Query { points: self.points(), object: self.rays.object.clone() }
    }
}

/// The plain marcher: every sample of every ray goes through the field. Slow, exact, the oracle of all others.
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

    /// Logits at one depth a ray, in chunks.
    fn logits_at(&self, rays: &Rays, depth: Tensor<1>) -> Tensor<1> {
        let query = Query { points: rays.at(depth), object: rays.object.clone() };
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
        let query = Query { points: points.reshape([n * steps, 3]), object };
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

/// What sampling a chunk of rays tells, one entry a ray; the bracket is meaningless where a ray does not hit.
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
