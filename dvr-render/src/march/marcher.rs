//! What a marcher is asked and what it answers.

use burn::tensor::{Int, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use crate::field::query::Query;
use crate::march::rays::Rays;
use crate::march::root::RootMethod;

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
    /// Evaluations per ray that the root search spends.
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
    /// rays, a marcher that stops at the surface knows only the samples before it.
    pub max_logit_depth: Tensor<1>,
}

impl March {
    /// From what a kernel leaves on the device, `[n, 3]`: the status of each ray as a number (0 misses, 1 hits, 2 starts
    /// inside), the depth of its crossing, and that of its largest logit. The status alone is read back.
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

    /// From numbers on the CPU, one per ray; the depth of a ray that does not hit has no meaning.
    ///
    /// # Panics
    /// When there are not as many numbers as rays.
    pub fn of_numbers(rays: &Rays, status: Vec<RayStatus>, depth: &[f32], max_logit_depth: Vec<f32>) -> Self {
        let n = rays.len();
        assert_eq!([status.len(), depth.len(), max_logit_depth.len()], [n; 3], "numbers per ray");
        let device = rays.entry.device();
        let floats = |values: Vec<f32>| {
            let count = values.len();
            Tensor::<1>::from_data(TensorData::new(values, [count]), &device)
        };
        let hits = Hits::places(&status, rays).map(|index| {
            let depth = RayStatus::hits(&status).into_iter().map(|ray| depth[ray as usize]).collect();
            Hits { rays: rays.select(&index), depth: floats(depth), index }
        });
        Self { hits, status, max_logit_depth: floats(max_logit_depth) }
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
    /// The statuses that a marcher left on the device as numbers, `[n]`: 0, 1 and 2 in the order of the variants. Reads
    /// them back.
    pub(super) fn read(codes: Tensor<1>) -> Vec<Self> {
        let status = |code: f32| match code {
            1.0 => Self::Hits,
            2.0 => Self::StartsInside,
            _ => Self::Misses,
        };
        codes.into_data().iter::<f32>().map(status).collect()
    }

    /// The places of the rays that hit, ascending.
    fn hits(statuses: &[Self]) -> Vec<i64> {
        statuses.iter().enumerate().filter(|(_, status)| **status == Self::Hits).map(|(i, _)| i as i64).collect()
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
    pub(super) fn places(statuses: &[RayStatus], rays: &Rays) -> Option<Tensor<1, Int>> {
        let places = RayStatus::hits(statuses);
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

    /// The crossings, as their rays see them.
    pub fn query(&self) -> Query {
        let directions = Some(self.rays.viewing_directions());
        Query { points: self.points(), directions, object: self.rays.object.clone() }
    }
}
