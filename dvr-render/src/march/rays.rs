//! Batches of rays on a device, cut to the part that lies in the padded unit cube.

use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::{Ray, UnitCube};

use crate::field::query::Query;

/// `n` rays `r(d) = origin + d * direction`, each with the interval of depths in which it may meet the object.
#[derive(Clone, Debug)]
pub struct Rays {
    /// `r0`, `[n, 3]`, object space.
    pub origin: Tensor<2>,
    /// `w`, `[n, 3]`, of any length but zero.
    pub direction: Tensor<2>,
    /// Depth at which the cube is entered, `[n]`; 0 for rays that start inside.
    pub entry: Tensor<1>,
    /// Depth at which it is left, `[n]`; smaller than `entry` where the ray misses the cube.
    pub exit: Tensor<1>,
    /// Index of the object a ray looks at, `[n]`; `None` where there is only object 0.
    pub object: Option<Tensor<1, Int>>,
}

impl Rays {
    /// Moves rays to a device and intersects them with the cube, in double precision.
    ///
    /// Rays that miss the cube stay in the batch, with an empty interval: they never hit.
    pub fn new(rays: &[Ray], cube: UnitCube, device: &Device) -> Self {
        let within: Vec<_> = rays
            .iter()
            .map(|ray| {
                let (entry, exit) = cube.intersect(ray).unwrap_or((0.0, -1.0));
                (*ray, entry, exit)
            })
            .collect();
        Self::within(&within, device)
    }

    /// Moves rays to a device, each with the depths `(entry, exit)` between which it is to be searched.
    pub fn within(rays: &[(Ray, f64, f64)], device: &Device) -> Self {
        let n = rays.len();
        let vectors = |part: fn(&Ray) -> glam::DVec3| -> Tensor<2> {
            let values: Vec<f64> = rays.iter().flat_map(|(ray, _, _)| part(ray).to_array()).collect();
            Tensor::from_data(TensorData::new(values, [n, 3]), device)
        };
        let depths = |part: fn(&(Ray, f64, f64)) -> f64| -> Tensor<1> {
            Tensor::from_data(TensorData::new(rays.iter().map(part).collect::<Vec<_>>(), [n]), device)
        };
        Self {
            origin: vectors(|ray| ray.origin),
            direction: vectors(|ray| ray.direction),
            entry: depths(|ray| ray.1),
            exit: depths(|ray| ray.2),
            object: None,
        }
    }

    /// How many rays there are.
    pub fn len(&self) -> usize {
        self.entry.dims()[0]
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The rays `start..start + length`.
    pub fn narrow(&self, start: usize, length: usize) -> Self {
        Self {
            origin: self.origin.clone().narrow(0, start, length),
            direction: self.direction.clone().narrow(0, start, length),
            entry: self.entry.clone().narrow(0, start, length),
            exit: self.exit.clone().narrow(0, start, length),
            object: self.object.clone().map(|o| o.narrow(0, start, length)),
        }
    }

    /// The rays with the given indices, `[m]`.
    pub fn select(&self, indices: &Tensor<1, Int>) -> Self {
        Self {
            origin: self.origin.clone().select(0, indices.clone()),
            direction: self.direction.clone().select(0, indices.clone()),
            entry: self.entry.clone().select(0, indices.clone()),
            exit: self.exit.clone().select(0, indices.clone()),
            object: self.object.clone().map(|o| o.select(0, indices.clone())),
        }
    }

    /// The points at one depth per ray, `[n, 3]`.
    pub fn at(&self, depth: Tensor<1>) -> Tensor<2> {
        self.origin.clone() + self.direction.clone() * depth.unsqueeze_dim(1)
    }

    /// The points at one depth per ray, without a view: what occupancy is asked.
    pub fn query_at(&self, depth: Tensor<1>) -> Query {
        Query { object: self.object.clone(), ..Query::new(self.at(depth)) }
    }

    /// Unit vectors along the rays, `[n, 3]`.
    pub fn viewing_directions(&self) -> Tensor<2> {
        self.direction.clone() / self.direction.clone().square().sum_dim(1).sqrt()
    }
}
