//! A small convolutional encoder with batch normalisation.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{BatchNorm, BatchNormConfig, Initializer, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::module::adaptive_avg_pool2d;
use burn::tensor::{Device, Tensor};

use super::normalised_convolutions::{Normalised, normalised_convolutions};
use crate::host_function::is_on_host;

/// Places along an edge of what is left of the picture: which way an object faces is easier to tell from where its parts are
/// than from their average alone.
const PLACES: usize = 2;

/// Five convolutions 3x3 of stride 2, each with a batch normalisation (Ioffe and Szegedy 2015) and a ReLU, their averages in the
/// four quarters of the picture, and a linear layer to the code.
///
/// As [`super::Convolutional`], but for the normalisation, the padding and the four places.
/// Where gradients are tracked, batch normalisation takes the batch's statistics and updates the running ones; elsewhere it takes
/// the running ones.
#[derive(Module, Debug)]
pub struct ConvolutionalBn {
    /// With `width`, `2 width`, and so on to `16 width` channels.
    pub layers: Vec<NormalisedConvolution>,
    /// Features to code, `[64 width, code_dim]`.
    pub fc: Linear,
}

impl ConvolutionalBn {
    /// Random parameters that keep the variance through ReLUs (He et al. 2015).
    pub fn new(width: usize, code_dim: usize, device: &Device) -> Self {
        let channels = [3, width, 2 * width, 4 * width, 8 * width, 16 * width];
        Self {
            layers: channels.windows(2).map(|pair| NormalisedConvolution::new([pair[0], pair[1]], device)).collect(),
            fc: LinearConfig::new(16 * width * PLACES * PLACES, code_dim).init(device),
        }
    }

    /// Codes `[b, code_dim]` of images `[b, 3, height, width]`, sRGB in `[0, 1]`.
    pub fn forward(&self, images: Tensor<4>) -> Tensor<2> {
        let last = self.layers.len().saturating_sub(1);
        let map = self.maps(images, last).pop().expect("there are layers");
        self.fc.forward(Self::places(map))
    }

    /// The maps of layer `first` and of all behind it, the finest first.
    pub(super) fn maps(&self, images: Tensor<4>, first: usize) -> Vec<Tensor<4>> {
        let is_host = self.layers.iter().all(|layer| is_on_host(&layer.conv.weight.val()));
        if is_host && images.device().is_autodiff() {
            let Normalised { maps, statistics } = normalised_convolutions(images, &self.layers, first);
            for (layer, [mean, variance]) in self.layers.iter().zip(statistics) {
                layer.remember(mean, variance);
            }
            return maps;
        }
        let mut net = images;
        let all = self.layers.iter().map(|layer| {
            net = layer.forward(net.clone());
            net.clone()
        });
        all.skip(first).collect()
    }

    /// What the code is made of: the averages of the last map in its quarters, `[b, 64 width]`.
    pub(super) fn places(map: Tensor<4>) -> Tensor<2> {
        let [_, _, height, width] = map.dims();
        let places = if [height, width] == [PLACES; 2] { map } else { adaptive_avg_pool2d(map, [PLACES; 2]) };
        places.flatten(1, 3)
    }
}

/// `relu(bn(conv(x)))`.
#[derive(Module, Debug)]
pub struct NormalisedConvolution {
    /// 3x3, stride 2, padding 1, without bias.
    pub conv: Conv2d,
    /// After it.
    pub bn: BatchNorm,
}

impl NormalisedConvolution {
    fn new(channels: [usize; 2], device: &Device) -> Self {
        let conv = Conv2dConfig::new(channels, [3, 3])
            .with_stride([2, 2])
            .with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1))
            .with_bias(false)
            .with_initializer(Initializer::KaimingUniform { gain: f64::sqrt(2.0), fan_out_only: false })
            .init(device);
        Self { conv, bn: BatchNormConfig::new(channels[1]).init(device) }
    }

    /// Takes the statistics of a batch into the running ones, as the batch normalisation does by itself.
    pub(super) fn remember(&self, mean: Tensor<1>, variance: Tensor<1>) {
        let momentum = self.bn.momentum;
        for (running, of_batch) in [(&self.bn.running_mean, mean), (&self.bn.running_var, variance)] {
            running.update((running.value_sync() * (1.0 - momentum) + of_batch * momentum).detach());
            running.value_sync();
        }
    }

    pub(super) fn forward(&self, input: Tensor<4>) -> Tensor<4> {
        let net = self.bn.forward(self.conv.forward(input));
        if net.device().is_autodiff() {
            // burn keeps a layer's last update aside until the next one, where a checkpoint taken in between would miss it.
            self.bn.running_mean.value_sync();
            self.bn.running_var.value_sync();
        }
        relu(net)
    }
}
