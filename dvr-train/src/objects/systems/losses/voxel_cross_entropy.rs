//! Cross entropy of voxels against the true ones (Choy et al. 2016, equation 8).

use burn::tensor::{Tensor, TensorData};

use crate::learners::losses::known_occupancy;

/// The mean over all voxels of logits `[b, n, n, n]`, `[1]`. Voxels of the truth are in the same order, x fastest.
pub(crate) fn voxel_cross_entropy(logits: &Tensor<4>, truth: &[&[bool]]) -> Tensor<1> {
    let count: usize = logits.dims().iter().product();
    let signs: Vec<f32> = truth.iter().flat_map(|t| t.iter()).map(|&inside| if inside { 1.0 } else { -1.0 }).collect();
    let signs = Tensor::from_data(TensorData::new(signs, [count]), &logits.device());
    known_occupancy(logits.clone().reshape([count]), signs) / count as f64
}
