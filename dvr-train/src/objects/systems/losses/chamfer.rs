//! The Chamfer distance of point sets (Fan et al. 2017, equation 3), with squared distances.

use burn::tensor::{Int, Tensor, TensorData};
use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// The mean squared distance of points `[b, n, 3]` to the nearest of the true ones, and that of true points to the
/// nearest of these, added and averaged over the objects, `[1]`. Every object has as many true points.
pub(crate) fn chamfer(points: &Tensor<3>, truth: &[&[Vec3]]) -> Tensor<1> {
    matched(points, truth).0
}

/// The same, and for each point of each object the number of the nearest true one.
pub(crate) fn matched(points: &Tensor<3>, truth: &[&[Vec3]]) -> (Tensor<1>, Vec<Vec<usize>>) {
    let [objects, n, _] = points.dims();
    let device = points.device();
    let m = truth.first().map_or(0, |points| points.len());
    let made: Vec<f32> = points.clone().inner().into_data().iter::<f32>().collect();
    let of_each: Vec<(Vec<i64>, Vec<f32>, Vec<usize>)> = made
        .par_chunks(3 * n)
        .zip(truth)
        .enumerate()
        .map(|(object, (made, truth))| {
            let made: Vec<Vec3> = made.chunks(3).map(Vec3::from_slice).collect();
            let to_truth = nearest(&made, truth);
            let to_made = nearest(truth, &made);
            let targets = to_truth.iter().flat_map(|&i| truth[i].to_array()).collect();
            (to_made.into_iter().map(|i| (object * n + i) as i64).collect(), targets, to_truth)
        })
        .collect();
    let (mut rows, mut targets) = (Vec::with_capacity(objects * m), Vec::with_capacity(3 * objects * n));
    let mut nearest_truth = Vec::with_capacity(objects);
    for (of_rows, of_targets, to_truth) in of_each {
        rows.extend(of_rows);
        targets.extend(of_targets);
        nearest_truth.push(to_truth);
    }
    let flat = points.clone().reshape([objects * n, 3]);
    let targets = Tensor::<2>::from_data(TensorData::new(targets, [objects * n, 3]), &device);
    let accuracy = (flat.clone() - targets).square().sum() / (objects * n) as f64;
    let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [objects * m]), &device);
    let truth: Vec<f32> = truth.iter().copied().flatten().flat_map(|point| point.to_array()).collect();
    let truth = Tensor::<2>::from_data(TensorData::new(truth, [objects * m, 3]), &device);
    let completeness = (flat.select(0, rows) - truth).square().sum() / (objects * m) as f64;
    (accuracy + completeness, nearest_truth)
}

/// For each point the number of the nearest of `others`. Points that are no numbers get the first.
fn nearest(points: &[Vec3], others: &[Vec3]) -> Vec<usize> {
    let positions: Vec<[f64; 3]> = others.iter().map(|point| point.as_dvec3().to_array()).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions) else { return vec![0; points.len()] };
    let nearest = |point: &Vec3| {
        let point = point.as_dvec3().to_array();
        tree.query(&point).nearest_one::<SquaredEuclidean<f64>>().execute().item as usize
    };
    points.iter().map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    #[test]
    fn it_is_the_mean_of_squares_both_ways_and_pulls_each_point_to_its_nearest() {
        let points = Tensor::<3>::from_floats([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]], &Device::flex().autodiff());
        let points = points.require_grad();
        let truth = [Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.0, 0.0, 0.25)];
        let (loss, nearest_truth) = matched(&points, &[&truth]);
        assert_eq!(nearest_truth, [[1, 1]]);
        // Both points are nearest to the second; both true ones to the first point.
        let expected = (0.0625 + (1.0 + 0.0625)) / 2.0 + (0.25 + 0.0625) / 2.0;
        assert!((loss.clone().into_scalar::<f32>() - expected).abs() < 1e-6);
        let gradient: Vec<f32> = points.grad(&loss.backward()).unwrap().into_data().iter::<f32>().collect();
        let expected = [0.0, -0.5, -0.25 - 0.25, 1.0, 0.0, -0.25];
        for (found, expected) in gradient.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{gradient:?}");
        }
    }
}
