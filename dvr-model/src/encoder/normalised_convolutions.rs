//! Convolutions with batch normalisation on the CPU, with their gradient by hand.

use std::sync::{Arc, OnceLock};

use burn::tensor::Tensor;

use super::convolution::{Convolution, Map};
use super::convolutional_bn::NormalisedConvolution;
use crate::host_function::{HostFunction, host_function};

/// From one place of a kernel to the next.
const STRIDE: usize = 2;

/// What convolutions with batch normalisation make of a batch of pictures.
pub(super) struct Normalised {
    /// The maps that were asked for, the last of them the last of all, `[b, channels, height, width]` each.
    pub maps: Vec<Tensor<4>>,
    /// Of each layer, mean and variance of each channel over the batch, not on the graph.
    pub statistics: Vec<[Tensor<1>; 2]>,
}

/// `relu(bn(conv(x)))` for layer after layer, by the statistics of the batch; the maps of layer `first` and of all behind it. Gradients
/// reach the layers; pictures `[b, 3, height, width]` are constants.
pub(super) fn normalised_convolutions(images: Tensor<4>, layers: &[NormalisedConvolution], first: usize) -> Normalised {
    let [pictures, channels, height, width] = images.dims();
    let mut inputs: Vec<Tensor<1>> = Vec::new();
    let mut sizes = Vec::new();
    let mut of = Map { pictures, height, width, channels };
    for NormalisedConvolution { conv, bn } in layers {
        let convolution = Convolution::new(of, conv.weight.dims()[0], STRIDE);
        sizes.push(Layer { convolution, epsilon: bn.epsilon as f32 });
        inputs.extend([conv.weight.val().flatten(0, 3), bn.gamma.val(), bn.beta.val()]);
        of = convolution.to;
    }
    let pixels = images.permute([0, 2, 3, 1]).into_data().iter::<f32>().collect();
    let function = NormalisedLayers { layers: sizes.clone(), first, pixels, passes: OnceLock::new() };
    let found = host_function(Tensor::cat(inputs, 0), Arc::new(function));
    let mut at = 0;
    let mut next = |count: usize| {
        at += count;
        found.clone().narrow(0, at - count, count)
    };
    let maps = sizes[first..].iter().map(|layer| {
        let to = layer.convolution.to;
        let map = next(to.len()).reshape([pictures, to.height, to.width, to.channels]);
        map.permute([0, 3, 1, 2])
    });
    let maps = maps.collect();
    let statistics = sizes.iter().map(|layer| [0; 2].map(|_| next(layer.convolution.to.channels).detach()));
    Normalised { statistics: statistics.collect(), maps }
}

/// A convolution and its normalisation.
#[derive(Clone, Copy, Debug)]
struct Layer {
    convolution: Convolution,
    epsilon: f32,
}

impl Layer {
    /// Weights, factors and offsets.
    fn parameters(&self) -> usize {
        self.convolution.weights() + 2 * self.convolution.to.channels
    }
}

/// What a layer made of its input.
#[derive(Debug)]
struct Passed {
    /// The convolution.
    convolved: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
    /// Normalised, scaled, shifted, and through the ReLU.
    map: Vec<f32>,
}

impl Passed {
    fn new(layer: &Layer, parameters: &[f32], input: &[f32]) -> Self {
        let channels = layer.convolution.to.channels;
        let (weights, affine) = parameters.split_at(layer.convolution.weights());
        let (gamma, beta) = affine.split_at(channels);
        let Layer { convolution, epsilon } = layer;
        let convolved = convolution.convolve(&convolution.reordered(weights), input);
        let count = (convolved.len() / channels).max(1) as f64;
        let sum = sums(&convolved, channels, |value, _| f64::from(value));
        let mean: Vec<f32> = sum.iter().map(|sum| (sum / count) as f32).collect();
        let squares = sums(&convolved, channels, |value, channel| f64::from(value - mean[channel]).powi(2));
        let variance: Vec<f32> = squares.iter().map(|sum| (sum / count) as f32).collect();
        let factors: Vec<f32> = (0..channels).map(|c| gamma[c] / (variance[c] + epsilon).sqrt()).collect();
        let mut map = convolved.clone();
        for pixel in map.chunks_exact_mut(channels) {
            for (c, value) in pixel.iter_mut().enumerate() {
                let normalised = (*value - mean[c]) * factors[c] + beta[c];
                // What is no number stays none, so that a run that diverges is seen to.
                *value = if normalised > 0.0 { normalised } else { 0.0 * normalised };
            }
        }
        Self { convolved, mean, variance, map }
    }

    /// Takes a gradient by the map to one by the convolution, and returns those by the factors and offsets of the normalisation
    /// (Ioffe and Szegedy 2015, section 3).
    fn normalise_back(&self, layer: &Layer, gamma: &[f32], by: &mut [f32]) -> [Vec<f32>; 2] {
        let channels = layer.convolution.to.channels;
        let inverse: Vec<f32> = self.variance.iter().map(|variance| 1.0 / (variance + layer.epsilon).sqrt()).collect();
        by.iter_mut().zip(&self.map).for_each(|(by, &map)| *by = if map > 0.0 { *by } else { 0.0 });
        let by_beta = sums(by, channels, |by, _| f64::from(by));
        let mut by_gamma = vec![0.0; channels];
        for (by, value) in by.chunks_exact(channels).zip(self.convolved.chunks_exact(channels)) {
            for (c, sum) in by_gamma.iter_mut().enumerate() {
                *sum += f64::from(by[c] * (value[c] - self.mean[c]) * inverse[c]);
            }
        }
        let count = (by.len() / channels).max(1) as f64;
        let mean = |sum: &[f64]| -> Vec<f32> { sum.iter().map(|sum| (sum / count) as f32).collect() };
        let (mean_by, mean_along) = (mean(&by_beta), mean(&by_gamma));
        for (by, value) in by.chunks_exact_mut(channels).zip(self.convolved.chunks_exact(channels)) {
            for (c, by) in by.iter_mut().enumerate() {
                let normalised = (value[c] - self.mean[c]) * inverse[c];
                *by = gamma[c] * inverse[c] * (*by - mean_by[c] - normalised * mean_along[c]);
            }
        }
        [by_gamma, by_beta].map(|sum| sum.iter().map(|sum| *sum as f32).collect())
    }
}

/// Sums over all pixels, channel by channel.
fn sums(values: &[f32], channels: usize, of: impl Fn(f32, usize) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0; channels];
    for pixel in values.chunks_exact(channels) {
        for (channel, (sum, value)) in sums.iter_mut().zip(pixel).enumerate() {
            *sum += of(*value, channel);
        }
    }
    sums
}

/// The function. Its value are the maps from layer `first` on, pixel by pixel, and behind them mean and variance of each layer's
/// channels.
#[derive(Debug)]
struct NormalisedLayers {
    layers: Vec<Layer>,
    first: usize,
    /// The pictures.
    pixels: Vec<f32>,
    /// What the layers made, for the way back.
    passes: OnceLock<Vec<Passed>>,
}

impl NormalisedLayers {
    fn passes(&self, inputs: &[f32]) -> &[Passed] {
        self.passes.get_or_init(|| {
            let (mut passes, mut rest): (Vec<Passed>, _) = (Vec::new(), inputs);
            for layer in &self.layers {
                let (own, others) = rest.split_at(layer.parameters());
                let passed = Passed::new(layer, own, passes.last().map_or(&self.pixels, |passed| &passed.map));
                passes.push(passed);
                rest = others;
            }
            passes
        })
    }
}

impl HostFunction for NormalisedLayers {
    fn value(&self, inputs: &[f32]) -> Vec<f32> {
        let passes = self.passes(inputs);
        let mut value: Vec<f32> = passes[self.first..].iter().flat_map(|passed| &passed.map).copied().collect();
        passes.iter().for_each(|passed| value.extend(passed.mean.iter().chain(&passed.variance)));
        value
    }

    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32> {
        let passes = self.passes(inputs);
        let mut gradient = vec![0.0; inputs.len()];
        let mut end = inputs.len();
        // By the maps that are handed out, the last of which is the only one that nothing else depends on.
        let mut handed_out = by;
        let maps: Vec<&[f32]> = passes[self.first..]
            .iter()
            .map(|passed| {
                let (own, others) = handed_out.split_at(passed.map.len());
                handed_out = others;
                own
            })
            .collect();
        let mut by = vec![0.0; passes.last().map_or(0, |passed| passed.map.len())];
        for (i, (layer, passed)) in self.layers.iter().zip(passes).enumerate().rev() {
            if let Some(map) = i.checked_sub(self.first).and_then(|i| maps.get(i)) {
                by.iter_mut().zip(*map).for_each(|(by, own)| *by += own);
            }
            let own = end - layer.parameters()..end;
            end = own.start;
            let convolution = &layer.convolution;
            let (weights, affine) = inputs[own.clone()].split_at(convolution.weights());
            let channels = layer.convolution.to.channels;
            let [by_gamma, by_beta] = passed.normalise_back(layer, &affine[..channels], &mut by);
            let input = if i > 0 { &passes[i - 1].map } else { &self.pixels };
            let mut by_input = if i > 0 { vec![0.0; convolution.of.len()] } else { Vec::new() };
            let asked = (i > 0).then_some(&mut by_input[..]);
            let by_weights = convolution.convolve_back(&convolution.reordered(weights), input, &by, asked);
            let (of_weights, of_affine) = gradient[own].split_at_mut(convolution.weights());
            convolution.places(|at, from| of_weights[at] = by_weights[from]);
            of_affine[..channels].copy_from_slice(&by_gamma);
            of_affine[channels..].copy_from_slice(&by_beta);
            by = by_input;
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use dvr_test_support::largest;

    use super::super::convolutional_bn::ConvolutionalBn;
    use super::*;
    use crate::seeded;

    fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
        tensor.into_data().iter::<f32>().collect()
    }

    fn images(size: [usize; 2], device: &Device) -> Tensor<4> {
        let shape = [3, 3, size[0], size[1]];
        let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| (0.37 * (i * i) as f32).sin()).collect();
        Tensor::from_data(TensorData::new(values, shape), device)
    }

    /// Maps, gradients by all parameters of a sum over the maps, and what the running statistics are then.
    fn found(encoder: &ConvolutionalBn, maps: Vec<Tensor<4>>) -> Vec<Vec<f32>> {
        let weighted = maps.iter().enumerate().map(|(k, map)| {
            let places: Vec<f32> =
                (0..map.dims().iter().product()).map(|i: usize| ((1.3 + k as f32) * i as f32).cos()).collect();
            assert!(!places.is_empty());
            (map.clone() * Tensor::from_data(TensorData::new(places, map.dims()), &map.device())).sum()
        });
        let gradients = weighted.reduce(|a, b| a + b).expect("a map").backward();
        let mut all: Vec<Vec<f32>> = maps.into_iter().map(numbers).collect();
        for layer in &encoder.layers {
            all.push(numbers(layer.conv.weight.val().grad(&gradients).expect("a gradient")));
            all.push(numbers(layer.bn.gamma.val().grad(&gradients).expect("a gradient")));
            all.push(numbers(layer.bn.beta.val().grad(&gradients).expect("a gradient")));
            all.extend([numbers(layer.bn.running_mean.value()), numbers(layer.bn.running_var.value())]);
        }
        all
    }

    #[test]
    fn maps_gradients_and_statistics_are_those_of_burns_operations() {
        let device = Device::flex().autodiff();
        for (size, first) in [([64, 64], 4), ([21, 50], 4), ([64, 64], 0), ([21, 50], 2)] {
            let images = images(size, &device);
            // Clones share their running statistics.
            let new = || seeded(&device, 5, || ConvolutionalBn::new(4, 6, &device));
            let (of_burn, own) = (new(), new());
            let mut net = images.clone();
            let maps = of_burn.layers.iter().map(|layer| {
                net = layer.forward(net.clone());
                net.clone()
            });
            let expected = found(&of_burn, maps.skip(first).collect());
            let Normalised { maps, statistics } = normalised_convolutions(images, &own.layers, first);
            own.layers.iter().zip(statistics).for_each(|(layer, [mean, variance])| layer.remember(mean, variance));
            let ours = found(&own, maps);
            assert_eq!(ours.len(), expected.len());
            for (i, (ours, expected)) in ours.iter().zip(&expected).enumerate() {
                let largest_of = |values: &[f32]| largest(values.iter().map(|x| x.abs()));
                let apart = largest(ours.iter().zip(expected).map(|(a, b)| (a - b).abs()));
                assert!(largest_of(expected) > 0.0, "{size:?}, {i}");
                assert!(apart < 1e-4 * largest_of(expected), "{size:?}, {i}: {apart} of {}", largest_of(expected));
            }
        }
    }

    #[test]
    fn gradients_are_the_same_bits_whatever_the_threads() {
        let device = Device::flex().autodiff();
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let encoder = seeded(&device, 5, || ConvolutionalBn::new(4, 6, &device));
                found(&encoder, normalised_convolutions(images([32, 32], &device), &encoder.layers, 0).maps)
            })
        };
        assert!(with(1) == with(3));
    }

    #[test]
    fn what_is_no_number_is_not_hidden() {
        let device = Device::flex().autodiff();
        let encoder = seeded(&device, 5, || ConvolutionalBn::new(4, 6, &device));
        let maps = normalised_convolutions(images([32, 32], &device) * f32::NAN, &encoder.layers, 0).maps;
        assert!(maps.into_iter().flat_map(numbers).all(|value| value.is_nan()));
    }
}
