//! Shapes as occupancies of voxels.

use burn::module::{Module, Param};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::points::for_relu;

/// Voxels along an edge of the coarsest layer.
const COARSEST: usize = 4;

/// Logit of fresh voxels: a ray that passes 32 of them meets something about as likely as not. Where all were as likely full as
/// empty, no ray would see beyond the first, and all would be emptied before anything is learned.
const FIRST_LOGIT: f64 = -3.5;

/// How much fresh voxels differ.
const LAST_DEVIATION: f64 = 0.1;

/// A code as occupancies of 32^3 voxels: three transposed convolutions that double the resolution, from 4^3 on, the last to
/// one channel. So are the decoders of Choy et al. 2016 (3D-R2N2, section 4) and Tulsiani et al. 2017 (DRC, section 4.1), but
/// for their normalisation and residual connections.
#[derive(Module, Debug)]
pub struct VoxelDecoder {
    /// Code to the coarsest layer.
    pub fc: Linear,
    /// Of that layer, each number by itself: what all pictures have in common goes out of it. Rays that are stopped by the same
    /// block in all pictures say nothing of what is behind it, so that a shape for all, once it is solid, would stay.
    pub norm: BatchNorm,
    /// To 8^3 voxels.
    pub up0: Doubling,
    /// To 16^3 voxels.
    pub up1: Doubling,
    /// To 32^3 voxels.
    pub up2: Doubling,
}

impl VoxelDecoder {
    /// Voxels along an edge of the padded cube.
    pub const RESOLUTION: usize = 8 * COARSEST;

    /// Numbers of the coarsest layer for each channel of the finest hidden one.
    pub(super) const FIRST: usize = 16 * COARSEST.pow(3);

    /// Random parameters; the finest hidden layer has `width` channels, each coarser one four times as many.
    pub fn new(width: usize, code_dim: usize, device: &Device) -> Self {
        Self {
            fc: LinearConfig::new(code_dim, Self::FIRST * width).with_initializer(for_relu(code_dim)).init(device),
            norm: BatchNormConfig::new(Self::FIRST * width).init(device),
            up0: Doubling::new(16 * width, 4 * width, device),
            up1: Doubling::new(4 * width, width, device),
            up2: Doubling {
                taps: smooth_taps(
                    &Initializer::Normal { mean: 0.0, std: LAST_DEVIATION / (width as f64).sqrt() },
                    [width, 1],
                    device,
                ),
                bias: Initializer::Constant { value: FIRST_LOGIT }.init([1], device),
            },
        }
    }

    /// Occupancy logits `[b, 32, 32, 32]` of codes `[b, code_dim]`: of voxels of the padded cube, x fastest.
    pub fn forward(&self, codes: Tensor<2>) -> Tensor<4> {
        let [objects, _] = codes.dims();
        let coarsest = self.fc.forward(codes).unsqueeze_dim::<3>(2);
        let coarsest = relu(normalised(&self.norm, coarsest).squeeze_dim::<2>(2));
        let channels = coarsest.dims()[1] / COARSEST.pow(3);
        let net = coarsest.reshape([objects, COARSEST, COARSEST, COARSEST, channels]);
        let net = relu(self.up0.forward(net));
        let net = relu(self.up1.forward(net));
        self.up2.forward(net).squeeze_dim(4)
    }
}

/// By the batch's own statistics where gradients are tracked, and by the running ones elsewhere and for a single object, which
/// differs from nothing.
fn normalised(norm: &BatchNorm, net: Tensor<3>) -> Tensor<3> {
    let [objects, features, _] = net.dims();
    let is_training = net.device().is_autodiff();
    if is_training && objects == 1 {
        let of_feature = |values: Tensor<1>| values.reshape([1, features, 1]);
        let running = |values: Tensor<1>| of_feature(Tensor::from_inner(values));
        let deviation = (running(norm.running_var.value_sync().inner()) + norm.epsilon).sqrt();
        let net = (net - running(norm.running_mean.value_sync().inner())) / deviation;
        return net * of_feature(norm.gamma.val()) + of_feature(norm.beta.val());
    }
    let net = norm.forward(net);
    if is_training {
        // burn keeps a layer's last update aside until the next one, where a checkpoint taken in between would miss it.
        norm.running_mean.value_sync();
        norm.running_var.value_sync();
    }
    net
}

/// A transposed convolution of 4^3 taps, stride 2 and padding 1.
///
/// What it makes between the middles of eight neighbouring voxels, a block of 2^3, depends on these eight alone: so it is one
/// product of matrices, which is many times faster than burn's general convolutions in three dimensions and their gradients.
#[derive(Module, Debug)]
pub struct Doubling {
    /// Eight voxels to the eight between them, `[8 input, 8 output]`: z, y and x slowest to fastest, channels last.
    pub taps: Param<Tensor<2>>,
    /// Of each channel, `[output]`. One for each of the eight places would let a lattice of single voxels stop all rays.
    pub bias: Param<Tensor<1>>,
}

/// Taps that start as an interpolation of the eight voxels around a place, between `channels` of input and output that are
/// mixed at random (Long et al. 2015, section 3.3; against checkerboards Aitken et al. 2017). Where each of the eight places
/// of a block starts with taps of its own, the one that rises first stops all rays, and a lattice of single voxels is learned
/// from silhouettes.
fn smooth_taps(mixing: &Initializer, channels: [usize; 2], device: &Device) -> Param<Tensor<2>> {
    let [input, output] = channels;
    let mixing: Param<Tensor<2>> = mixing.init([input, output], device);
    let share = |corner: usize, place: usize| {
        let of_axis = |axis: usize| if corner >> axis & 1 == place >> axis & 1 { 0.75 } else { 0.25 };
        (0..3).map(of_axis).product::<f32>()
    };
    let shares: Vec<f32> = (0..8).flat_map(|corner| (0..8).map(move |place| share(corner, place))).collect();
    let shares = Tensor::<1>::from_floats(shares.as_slice(), device).reshape([8, 1, 8, 1]);
    let taps = mixing.val().reshape([1, input, 1, output]) * shares;
    // By its data: a parameter is no result of other tensors.
    Param::from_tensor(Tensor::from_data(taps.reshape([8 * input, 8 * output]).into_data(), device))
}

impl Doubling {
    fn new(input: usize, output: usize, device: &Device) -> Self {
        Self {
            taps: smooth_taps(&for_relu(input), [input, output], device),
            bias: Initializer::Zeros.init([output], device),
        }
    }

    /// From `[b, n, n, n, input]` to `[b, 2n, 2n, 2n, output]`.
    pub fn forward(&self, net: Tensor<5>) -> Tensor<5> {
        let [objects, n, _, _, channels] = net.dims();
        let padded = Tensor::zeros([objects, n + 2, n + 2, n + 2, channels], &net.device());
        let inner = 1..n + 1;
        let padded = padded.slice_assign([0..objects, inner.clone(), inner.clone(), inner, 0..channels], net);
        let blocks = n + 1;
        let corner = |corner: usize| {
            let [z, y, x] = [corner >> 2, corner >> 1 & 1, corner & 1].map(|at| at..at + blocks);
            padded.clone().slice([0..objects, z, y, x, 0..channels])
        };
        let around = Tensor::cat((0..8).map(corner).collect(), 4).reshape([objects * blocks.pow(3), 8 * channels]);
        let output = self.bias.dims()[0];
        let made = around.matmul(self.taps.val()).reshape([objects, blocks, blocks, blocks, 2, 2, 2, output]);
        let made = made.permute([0, 1, 4, 2, 5, 3, 6, 7]);
        let made = made.reshape([objects, 2 * blocks, 2 * blocks, 2 * blocks, output]);
        let inner = 1..2 * blocks - 1;
        let made = made.slice([0..objects, inner.clone(), inner.clone(), inner, 0..output]);
        made + self.bias.val().reshape([1, 1, 1, 1, output])
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Distribution;
    use burn::tensor::module::conv_transpose3d;
    use burn::tensor::ops::ConvTransposeOptions;

    use super::*;

    #[test]
    fn doubling_is_a_transposed_convolution() {
        let device = Device::flex();
        let (input, output, n) = (3, 2, 4);
        let mut doubling = Doubling::new(input, output, &device);
        doubling.bias = Initializer::Constant { value: 0.3 }.init([output], &device);
        let net = Tensor::<5>::random([2, n, n, n, input], Distribution::Default, &device);
        let made = doubling.forward(net.clone());
        // Of a block's voxels, the one at 0 lies nearest to the first of the eight around it: its tap is the third of four, that
        // of the second the first.
        let taps: Vec<f32> = doubling.taps.val().into_data().iter::<f32>().collect();
        let mut weight = vec![0f32; input * output * 64];
        for (row, from) in (0..8).flat_map(|corner| (0..input).map(move |channel| (corner, channel))).enumerate() {
            for (column, to) in (0..8).flat_map(|place| (0..output).map(move |channel| (place, channel))).enumerate() {
                let tap = |axis: usize| match (from.0 >> axis & 1, to.0 >> axis & 1) {
                    (0, 0) => 2,
                    (1, 0) => 0,
                    (0, _) => 3,
                    (_, _) => 1,
                };
                let at = (((from.1 * output + to.1) * 4 + tap(2)) * 4 + tap(1)) * 4 + tap(0);
                weight[at] = taps[row * 8 * output + column];
            }
        }
        let weight = Tensor::<1>::from_floats(weight.as_slice(), &device).reshape([input, output, 4, 4, 4]);
        let options = ConvTransposeOptions::new([2; 3], [1; 3], [0; 3], [1; 3], 1);
        let channels_first = net.permute([0, 4, 1, 2, 3]);
        let expected =
            conv_transpose3d(channels_first, weight, Some(doubling.bias.val()), options).permute([0, 2, 3, 4, 1]);
        let off = (made - expected).abs().max().into_scalar::<f32>();
        assert!(off < 1e-5, "{off}");
    }
}
