//! The small convolutional encoder of DVR's reference code.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor};

use super::pooling::global_mean;

/// Five convolutions 3x3 of stride 2 without padding, their global average, and a linear layer to the code.
///
/// ReLUs stand between all of them, the average included: `fc_out(relu(mean(conv4(relu(...conv0(image))))))`. There is
/// no normalisation of any kind. Parameter names are those of the reference code's `ConvEncoder`, below `encoder.`.
#[derive(Module, Debug)]
pub struct Convolutional {
    /// `width` channels.
    pub conv0: Conv2d,
    /// `2 width` channels.
    pub conv1: Conv2d,
    /// `4 width` channels.
    pub conv2: Conv2d,
    /// `8 width` channels.
    pub conv3: Conv2d,
    /// `16 width` channels.
    pub conv4: Conv2d,
    /// Features to code, `[16 width, code_dim]`.
    pub fc_out: Linear,
}

impl Convolutional {
    /// Side of the smallest image that leaves something to average: five times `(n - 3) / 2 + 1`, down to 1.
    pub const SMALLEST_IMAGE: usize = 63;

    /// Random parameters that keep the variance through ReLUs (He et al. 2015). The reference code's `width` is 32.
    ///
    /// PyTorch's own draw, which the reference code starts from, shrinks the difference of two pictures by a factor of 2.4 per
    /// layer: codes are then all but equal, and it takes ten thousands of steps until they are not.
    pub fn new(width: usize, code_dim: usize, device: &Device) -> Self {
        let initializer = Initializer::KaimingUniform { gain: f64::sqrt(2.0), fan_out_only: false };
        let convolution = |input, output| {
            Conv2dConfig::new([input, output], [3, 3])
                .with_stride([2, 2])
                .with_initializer(initializer.clone())
                .init(device)
        };
        Self {
            conv0: convolution(3, width),
            conv1: convolution(width, 2 * width),
            conv2: convolution(2 * width, 4 * width),
            conv3: convolution(4 * width, 8 * width),
            conv4: convolution(8 * width, 16 * width),
            fc_out: LinearConfig::new(16 * width, code_dim).init(device),
        }
    }

    /// Codes `[b, code_dim]` of images `[b, 3, height, width]`, sRGB in `[0, 1]`.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let [.., last] = self.maps(images);
        self.code(relu(global_mean(last)))
    }

    /// What the convolutions make, before their ReLUs.
    pub(super) fn maps(&self, images: Tensor<4>) -> [Tensor<4>; 5] {
        let map0 = self.conv0.forward(images);
        let map1 = self.conv1.forward(relu(map0.clone()));
        let map2 = self.conv2.forward(relu(map1.clone()));
        let map3 = self.conv3.forward(relu(map2.clone()));
        let map4 = self.conv4.forward(relu(map3.clone()));
        [map0, map1, map2, map3, map4]
    }

    /// Codes of the features of pictures, `[b, 16 width]`.
    pub(super) fn code(&self, features: Tensor<2>) -> Tensor<2> {
        self.fc_out.forward(features)
    }
}
