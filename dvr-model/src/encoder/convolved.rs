//! A convolution with its offsets on the CPU, with its gradient by hand.

use std::sync::Arc;

use burn::nn::conv::Conv2d;
use burn::tensor::Tensor;

use super::convolution::{Convolution, Map};
use crate::host_function::{HostFunction, host_function};

/// What a convolution 3x3 with stride 1, padding 1 and a bias makes of maps `[b, channels, height, width]`; gradients reach both.
pub(super) fn convolved(maps: Tensor<4>, conv: &Conv2d) -> Tensor<4> {
    let [pictures, channels, height, width] = maps.dims();
    let convolution = Convolution::new(Map { pictures, height, width, channels }, conv.weight.dims()[0], 1);
    let to = convolution.to;
    let bias = conv.bias.as_ref().map_or_else(|| Tensor::zeros([to.channels], &maps.device()), |bias| bias.val());
    let pixels = maps.permute([0, 2, 3, 1]).flatten(0, 3);
    let inputs = Tensor::cat(vec![conv.weight.val().flatten(0, 3), bias, pixels], 0);
    let map = host_function(inputs, Arc::new(Convolved { convolution }));
    map.reshape([pictures, to.height, to.width, to.channels]).permute([0, 3, 1, 2])
}

/// From weights, offsets and maps, one after the other, to maps.
#[derive(Debug)]
struct Convolved {
    convolution: Convolution,
}

impl Convolved {
    /// Weights, offsets, maps.
    fn parts<'a>(&self, inputs: &'a [f32]) -> [&'a [f32]; 3] {
        let (weights, others) = inputs.split_at(self.convolution.weights());
        let (bias, maps) = others.split_at(self.convolution.to.channels);
        [weights, bias, maps]
    }
}

impl HostFunction for Convolved {
    fn value(&self, inputs: &[f32]) -> Vec<f32> {
        let [weights, bias, maps] = self.parts(inputs);
        let mut value = self.convolution.convolve(&self.convolution.reordered(weights), maps);
        for pixel in value.chunks_exact_mut(bias.len()) {
            pixel.iter_mut().zip(bias).for_each(|(value, bias)| *value += bias);
        }
        value
    }

    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32> {
        let [weights, bias, maps] = self.parts(inputs);
        let mut gradient = vec![0.0; inputs.len()];
        let (by_weights, others) = gradient.split_at_mut(weights.len());
        let (by_bias, by_maps) = others.split_at_mut(bias.len());
        for pixel in by.chunks_exact(bias.len()) {
            by_bias.iter_mut().zip(pixel).for_each(|(sum, by)| *sum += by);
        }
        let reordered = self.convolution.reordered(weights);
        let of_matrix = self.convolution.convolve_back(&reordered, maps, by, Some(by_maps));
        self.convolution.places(|at, from| by_weights[at] = of_matrix[from]);
        gradient
    }
}

#[cfg(test)]
mod tests {
    use burn::nn::PaddingConfig2d;
    use burn::nn::conv::Conv2dConfig;
    use burn::tensor::{Device, TensorData};
    use dvr_test_support::{largest, max_difference};

    use super::*;
    use crate::seeded;

    #[test]
    fn maps_and_gradients_are_those_of_burns_operations() {
        let device = Device::flex().autodiff();
        let conv = seeded(&device, 5, || {
            Conv2dConfig::new([6, 5], [3, 3]).with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1)).init(&device)
        });
        let waves = |shape: [usize; 4], pace: f32| {
            let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| (pace * i as f32).sin()).collect();
            Tensor::<4>::from_data(TensorData::new(values, shape), &device)
        };
        let maps = waves([3, 6, 9, 7], 0.7).require_grad();
        let found = |map: Tensor<4>| {
            let gradients = (map.clone() * waves([3, 5, 9, 7], 1.3)).sum().backward();
            let bias = conv.bias.as_ref().expect("a bias").val().grad(&gradients).expect("a gradient");
            let weight = conv.weight.val().grad(&gradients).expect("a gradient");
            let by_maps = maps.grad(&gradients).expect("a gradient");
            [map.flatten::<1>(0, 3).inner(), bias, weight.flatten(0, 3), by_maps.flatten(0, 3)]
                .map(|tensor| tensor.into_data().iter::<f32>().collect::<Vec<_>>())
        };
        let expected = found(conv.forward(maps.clone()));
        let by_hand = found(convolved(maps.clone(), &conv));
        for (i, (by_hand, expected)) in by_hand.iter().zip(&expected).enumerate() {
            let size = largest(expected.iter().map(|value| value.abs()));
            assert!(size > 0.0 && max_difference(by_hand, expected) < 1e-5 * size, "{i}");
        }
    }
}
