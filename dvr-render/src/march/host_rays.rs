//! Rays as numbers on the CPU.

use burn::tensor::Tensor;
use glam::Vec3;

use crate::march::rays::Rays;

/// A batch of rays as numbers on the CPU; see [`Rays`].
#[derive(Clone, Debug)]
pub struct HostRays {
    /// Where each ray starts.
    pub origin: Vec<Vec3>,
    /// Along what it runs.
    pub direction: Vec<Vec3>,
    /// Depth at which it enters.
    pub entry: Vec<f32>,
    /// Depth at which it leaves.
    pub exit: Vec<f32>,
    /// Shift of its samples, if they are shifted.
    pub jitter: Option<Vec<f32>>,
    /// Its object, if there are several.
    pub object: Option<Vec<usize>>,
}

impl HostRays {
    /// Reads a batch back, with the `jitter` of its march, `[n]`.
    pub fn new(rays: &Rays, jitter: Option<Tensor<1>>) -> Self {
        let numbers = |values: Tensor<1>| values.into_data().iter::<f32>().collect::<Vec<_>>();
        let vectors = |values: &Tensor<2>| {
            let flat: Vec<f32> = values.clone().into_data().iter::<f32>().collect();
            flat.as_chunks().0.iter().map(|&v| Vec3::from_array(v)).collect()
        };
        let object = rays.object.clone().map(|object| object.into_data().iter::<i64>().map(|i| i as usize).collect());
        Self {
            origin: vectors(&rays.origin),
            direction: vectors(&rays.direction),
            entry: numbers(rays.entry.clone()),
            exit: numbers(rays.exit.clone()),
            jitter: jitter.map(numbers),
            object,
        }
    }

    /// The object that a ray looks at.
    pub fn object(&self, ray: usize) -> usize {
        self.object.as_ref().map_or(0, |object| object[ray])
    }

    /// The point at a depth.
    pub fn at(&self, ray: usize, depth: f32) -> Vec3 {
        self.origin[ray] + self.direction[ray] * depth
    }

    /// Depth of one of `samples` samples, counted from 0.
    pub fn depth_of(&self, ray: usize, sample: usize, samples: usize) -> f32 {
        let share = match &self.jitter {
            None => sample as f32 / (samples - 1) as f32,
            Some(jitter) => (sample as f32 + jitter[ray]) / samples as f32,
        };
        self.entry[ray] + (self.exit[ray] - self.entry[ray]) * share
    }
}
