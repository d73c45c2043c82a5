//! Features of many points looked up on the CPU, with their gradient by hand: burn's operations add up four planes' worth of
//! gradients, each of all places.

use std::sync::Arc;

use burn::tensor::{Int, Tensor};
use glam::Vec3;
use rayon::prelude::*;

use super::PixelAligned;
use super::plane::{Cell, Projection};
use crate::host_function::{HostFunction, host_function};

/// Points that a thread looks up at a time.
const CHUNK: usize = 256;

/// From the features of all places, `[objects * side * side, channels]`, to those of points.
#[derive(Debug)]
struct LookedUp {
    side: usize,
    channels: usize,
    objects: usize,
    /// The object of each point, and where it lies in that object's plane.
    cells: Vec<(usize, Cell)>,
}

/// [`PixelAligned::at`]; gradients reach the features, and points are constants.
pub(super) fn looked_up(aligned: &PixelAligned, points: &Tensor<2>, object: &Tensor<1, Int>) -> Tensor<2> {
    let (side, [rows, channels]) = (aligned.side, aligned.rows.dims());
    let projections = aligned.host_projections();
    let points: Vec<f32> = points.clone().into_data().iter::<f32>().collect();
    let object = object.clone().into_data();
    let cells = points.as_chunks().0.iter().zip(object.iter::<i64>()).map(|(point, object)| {
        let object = object as usize;
        (object, projections[object].cell(Vec3::from_array(*point)))
    });
    let cells: Vec<_> = cells.collect();
    let count = cells.len();
    let function = LookedUp { side, channels, objects: rows / (side * side), cells };
    host_function(aligned.rows.clone().flatten(0, 1), Arc::new(function)).reshape([count, channels])
}

impl HostFunction for LookedUp {
    fn value(&self, inputs: &[f32]) -> Vec<f32> {
        let (side, channels) = (self.side, self.channels);
        let mut values = vec![0.0; self.cells.len() * channels];
        values.par_chunks_mut(CHUNK * channels).zip(self.cells.par_chunks(CHUNK)).for_each(|(values, cells)| {
            for (value, (object, cell)) in values.chunks_exact_mut(channels).zip(cells) {
                for (place, weight) in cell.around(side) {
                    let features = &inputs[(object * side * side + place) * channels..][..channels];
                    value.iter_mut().zip(features).for_each(|(value, feature)| *value += weight * feature);
                }
            }
        });
        values
    }

    /// Object by object, so that no sum depends on how many threads there are.
    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32> {
        let (side, channels) = (self.side, self.channels);
        let mut points = vec![Vec::new(); self.objects];
        for (point, (object, cell)) in self.cells.iter().enumerate() {
            points[*object].push((point, cell));
        }
        let mut gradient = vec![0.0; inputs.len()];
        gradient.par_chunks_mut(side * side * channels).zip(points).for_each(|(gradient, points)| {
            for (point, cell) in points {
                let by = &by[point * channels..][..channels];
                for (place, weight) in cell.around(side) {
                    let sum = &mut gradient[place * channels..][..channels];
                    sum.iter_mut().zip(by).for_each(|(sum, by)| *sum += weight * by);
                }
            }
        });
        gradient
    }
}

impl PixelAligned {
    /// The cameras, object by object.
    pub(super) fn host_projections(&self) -> Vec<Projection> {
        let numbers: Vec<f32> = self.projections.clone().into_data().iter::<f32>().collect();
        numbers.chunks(12).map(|matrix| Projection::new(matrix, self.side)).collect()
    }
}
