//! A burn field as extraction wants it: batches of points in, numbers out, all cores used.

use burn::tensor::{Tensor, TensorData};
use glam::Vec3;

use crate::chunks::{in_parallel, points_at_once};
use crate::field::crossing::{Crossing, Snapshot};
use crate::field::query::Query;
use crate::field::scalar::ScalarField;
use crate::march::marcher::{MarchSettings, Marcher};
use crate::march::snapshot::SnapshotMarcher;
use crate::march::tensor::TensorMarcher;

/// Points evaluated at once by a thread of a CPU: small enough for the activations to stay in cache.
const CHUNK: usize = 4096;

/// A field without gradient tracking, as it is now: marched, and asked as a [`ScalarField`], in the fastest way that
/// its [`Crossing`] names. Snapshots are made once, here.
pub struct FieldSurface<F> {
    field: F,
    snapshots: Vec<Snapshot>,
}

impl<F: Crossing> FieldSurface<F> {
    /// Wraps a field, which must not track gradients (`Module::valid`), or a reference to one.
    pub fn new(field: F) -> Self {
        let snapshots = field.snapshots();
        Self { field, snapshots }
    }

    /// The field.
    pub fn field(&self) -> &F {
        &self.field
    }

    /// Whether the field is asked through tensors, on its own device, since it has no snapshots.
    pub(crate) fn asks_tensors(&self) -> bool {
        self.snapshots.is_empty()
    }

    /// The fastest marcher that the field has.
    pub fn marcher(&self, settings: MarchSettings) -> Box<dyn Marcher + '_> {
        if let Some(marcher) = self.field.own_marcher(settings) {
            marcher
        } else if !self.asks_tensors() {
            Box::new(SnapshotMarcher::new(&self.snapshots, settings))
        } else {
            Box::new(TensorMarcher::new(&self.field, settings))
        }
    }

    /// Evaluates chunks; the results stand in the order of the points, whatever the threads do.
    fn in_chunks<T: Send>(
        &self,
        points: &[Vec3],
        directions: Option<&[Vec3]>,
        evaluate: impl Fn(&Query) -> Vec<T> + Sync,
    ) -> Vec<T> {
        let device = self.field.device();
        let size = points_at_once(&device, CHUNK);
        let tensor = |vectors: &[Vec3]| {
            let flat: Vec<f32> = vectors.iter().flat_map(|v| v.to_array()).collect();
            Tensor::from_data(TensorData::new(flat, [vectors.len(), 3]), &device)
        };
        let jobs = points.chunks(size).enumerate().collect();
        let parts = in_parallel(&device, jobs, |(i, chunk): (usize, &[Vec3])| {
            let directions = directions.map(|directions| tensor(&directions[i * size..i * size + chunk.len()]));
            evaluate(&Query { directions, ..Query::new(tensor(chunk)) })
        });
        parts.into_iter().flatten().collect()
    }
}

/// Rows of an `[n, 3]` tensor.
fn triples(tensor: Tensor<2>) -> Vec<[f32; 3]> {
    let flat: Vec<f32> = tensor.into_data().iter::<f32>().collect();
    flat.as_chunks().0.to_vec()
}

impl<F: Crossing> ScalarField for FieldSurface<F> {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        if let Some(snapshot) = self.snapshots.first() {
            return snapshot.logits(points);
        }
        self.in_chunks(points, None, |query| self.field.occupancy_logit(query).into_data().iter::<f32>().collect())
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        if let Some(snapshot) = self.snapshots.first() {
            return snapshot.gradients(points);
        }
        let rows = |query: &Query| triples(self.field.occupancy_gradient(query)).into_iter().map(Vec3::from).collect();
        Some(self.in_chunks(points, None, rows))
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        if let Some(snapshot) = self.snapshots.first() {
            return snapshot.colors(points, normals, directions);
        }
        Some(self.in_chunks(points, directions, |query| triples(self.field.evaluate(query).color)))
    }
}
