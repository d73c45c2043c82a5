//! Pooling that both image encoders end with.

use burn::tensor::Tensor;

/// The mean of each channel, `[b, channels, height, width]` to `[b, channels]`.
pub(super) fn global_mean(net: Tensor<4>) -> Tensor<2> {
    net.flatten::<3>(2, 3).mean_dim(2).squeeze_dim(2)
}
