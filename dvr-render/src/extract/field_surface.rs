//! A burn field as extraction wants it: batches of points in, numbers out, all cores used.

use burn::tensor::{Tensor, TensorData};
use glam::Vec3;

use super::ScalarField;
use crate::chunks::{in_parallel, points_at_once};
use crate::field::{Field, Query, Snapshot};
use crate::march::{MarchSettings, Marcher, TensorMarcher};
use crate::snapshot_march::SnapshotMarcher;

/// Points evaluated at once by a thread of a CPU: small enough for the activations to stay in cache.
const CHUNK: usize = 4096;

/// A [`Field`] without gradient tracking, seen as a [`ScalarField`] and marched: through its snapshots where it has
/// any, on its device otherwise.
pub struct FieldSurface<F> {
    field: F,
    snapshots: Vec<Snapshot>,
}

impl<F: Field> FieldSurface<F> {
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
        if !self.asks_tensors() {
            Box::new(SnapshotMarcher::new(&self.snapshots, settings))
        } else if let Some(marcher) = self.field.device_marcher(settings) {
            marcher
        } else {
            Box::new(TensorMarcher::new(&self.field, settings))
        }
    }

    /// Evaluates chunks; the results stand in the order of the points, whatever the threads do.
    fn in_chunks<T: Send>(&self, points: &[Vec3], evaluate: impl Fn(&Query) -> Vec<T> + Sync) -> Vec<T> {
        let device = self.field.device();
        let jobs = points.chunks(points_at_once(&device, CHUNK)).collect();
        let parts = in_parallel(&device, jobs, |chunk: &[Vec3]| {
            let flat: Vec<f32> = chunk.iter().flat_map(|p| p.to_array()).collect();
            evaluate(&Query::new(Tensor::from_data(TensorData::new(flat, [chunk.len(), 3]), &device)))
        });
        parts.into_iter().flatten().collect()
    }
}

/// Rows of an `[n, 3]` tensor.
fn triples(tensor: Tensor<2>) -> Vec<[f32; 3]> {
    let flat: Vec<f32> = tensor.into_data().iter::<f32>().collect();
    flat.as_chunks().0.to_vec()
}

impl<F: Field> ScalarField for FieldSurface<F> {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        if let Some(snapshot) = self.snapshots.first() {
            return snapshot.logits(points);
        }
        self.in_chunks(points, |query| self.field.occupancy_logit(query).into_data().iter::<f32>().collect())
    }

    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        if let Some(snapshot) = self.snapshots.first() {
            return snapshot.gradients(points);
        }
        let rows = |query: &Query| triples(self.field.occupancy_gradient(query)).into_iter().map(Vec3::from).collect();
        Some(self.in_chunks(points, rows))
    }

    fn colors(&self, points: &[Vec3], normals: &[Vec3]) -> Option<Vec<[f32; 3]>> {
        if let Some(snapshot) = self.snapshots.first() {
            return snapshot.colors(points, normals);
        }
        Some(self.in_chunks(points, |query| triples(self.field.evaluate(query).color)))
    }
}
