//! The losses of the paper (DVR, section 3.4 and supplement), one function an equation, each a sum over its points.
//!
//! Sums, because the terms of a step are divided by one common number of rays: each ray then counts the same in each
//! term, however many rays the term has. All results are `[1]`.

use burn::tensor::Tensor;
use burn::tensor::activation::softplus;

/// L1 between predicted and true colours, `[n, 3]`, summed over channels: `sum |c - c*|`.
pub fn color_l1(predicted: Tensor<2>, truth: Tensor<2>) -> Tensor<1> {
    (predicted - truth).abs().sum()
}

/// Difference of image gradients over square patches of neighbouring pixels (DVR supplement, "texture loss").
///
/// `predicted` and `truth` hold `patches * size * size` colours, `[n, 3]`, row by row within a patch, and only patches
/// all of whose pixels are valid. The gradient is the forward difference at a patch's top left pixel; the result is
/// `sum over patches and channels |grad c - grad c*|_2`.
pub fn image_gradient(predicted: Tensor<2>, truth: Tensor<2>, patch_size: usize) -> Tensor<1> {
    let pixels = patch_size * patch_size;
    let error = predicted - truth;
    let patches = error.dims()[0] / pixels;
    let error = error.reshape([patches, pixels, 3]);
    let pixel = |i: usize| error.clone().narrow(1, i, 1);
    let along_x = pixel(1) - pixel(0);
    let along_y = pixel(patch_size) - pixel(0);
    safe_sqrt(along_x.square() + along_y.square()).sum()
}

/// L1 between predicted and true depths, `[n]`, both in camera z or both ray depths.
pub fn depth_l1(predicted: Tensor<1>, truth: Tensor<1>) -> Tensor<1> {
    (predicted - truth).abs().sum()
}

/// Distance between predicted and true surface points, `[n, 3]`: `sum |p - p*|_2`.
pub fn point_distance(predicted: Tensor<2>, truth: Tensor<2>) -> Tensor<1> {
    safe_sqrt((predicted - truth).square().sum_dim(1)).sum()
}

/// Cross entropy that wants points outside: `sum softplus(f)`. For rays of background pixels (equation 10).
pub fn free_space(logit: Tensor<1>) -> Tensor<1> {
    softplus(logit, 1.0).sum()
}

/// Cross entropy that wants points inside: `sum softplus(-f)`. For rays of object pixels that hit nothing (equation
/// 11).
pub fn occupancy(logit: Tensor<1>) -> Tensor<1> {
    softplus(logit.neg(), 1.0).sum()
}

/// Cross entropy against known occupancies: `sum softplus(-s f)`, with the sign `s`, `[n]`, 1 where inside and -1 where
/// outside. The objective of Occupancy Networks (Mescheder et al. 2019, equation 3).
pub fn known_occupancy(logit: Tensor<1>, sign: Tensor<1>) -> Tensor<1> {
    softplus((logit * sign).neg(), 1.0).sum()
}

/// Smoothness of the surface: `sum |n(p) - n(q)|_2` for neighbouring points `p`, `q` (equation 12).
///
/// Takes the two gradients of the occupancy, `[n, 3]`, of any length.
pub fn normal_smoothness(gradient: Tensor<2>, neighbor_gradient: Tensor<2>) -> Tensor<1> {
    safe_sqrt((normalized(gradient) - normalized(neighbor_gradient)).square().sum_dim(1)).sum()
}

/// Rows scaled to unit length; a row of zeros stays.
fn normalized(vectors: Tensor<2>) -> Tensor<2> {
    let length = safe_sqrt(vectors.clone().square().sum_dim(1));
    vectors / length
}

/// A square root whose gradient is finite at 0: `sqrt(x + 1e-20)`, which is `sqrt(x)` to single precision above 1e-13.
fn safe_sqrt<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    (x + 1e-20).sqrt()
}
