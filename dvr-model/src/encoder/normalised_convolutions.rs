//! Convolutions with batch normalisation on the CPU, with their gradient by hand.
//!
//! Pictures lie pixel by pixel, all channels of a pixel side by side: what a convolution sees of a pixel's neighbourhood is then
//! a row of a matrix, and the convolution a product.

use std::sync::{Arc, OnceLock};

use burn::tensor::Tensor;
use ndarray::linalg::general_mat_mul;
use ndarray::s;
use rayon::prelude::*;

use super::convolutional_bn::NormalisedConvolution;
use crate::host_function::{HostFunction, host_function};
use crate::matrices::{matrix, matrix_mut};

/// Pixels along an edge of what a convolution sees.
const KERNEL: usize = 3;

/// Places of a kernel.
const TAPS: usize = KERNEL * KERNEL;

/// From one place of a kernel to the next.
const STRIDE: usize = 2;

/// Numbers of a cache line.
const LINE: usize = 16;

/// Numbers of neighbourhoods that are written down at a time, at most: 16 MiB.
const NEIGHBOURHOODS: usize = 1 << 22;

/// What convolutions with batch normalisation make of a batch of pictures.
pub(super) struct Normalised {
    /// The last map, `[b, channels, height, width]`.
    pub map: Tensor<4>,
    /// Of each layer, mean and variance of each channel over the batch, not on the graph.
    pub statistics: Vec<[Tensor<1>; 2]>,
}

/// `relu(bn(conv(x)))` for layer after layer, by the statistics of the batch. Gradients reach the layers; pictures
/// `[b, 3, height, width]` are constants.
pub(super) fn normalised_convolutions(images: Tensor<4>, layers: &[NormalisedConvolution]) -> Normalised {
    let [pictures, channels, height, width] = images.dims();
    let mut inputs: Vec<Tensor<1>> = Vec::new();
    let mut sizes = Vec::new();
    let mut of = Map { pictures, height, width, channels };
    for NormalisedConvolution { conv, bn } in layers {
        let to = of.halved(conv.weight.dims()[0]);
        sizes.push(Layer { of, to, epsilon: bn.epsilon as f32 });
        inputs.extend([conv.weight.val().flatten(0, 3), bn.gamma.val(), bn.beta.val()]);
        of = to;
    }
    let pixels = images.permute([0, 2, 3, 1]).into_data().iter::<f32>().collect();
    let function = Convolutions { layers: sizes.clone(), pixels, passes: OnceLock::new() };
    let found = host_function(Tensor::cat(inputs, 0), Arc::new(function));
    let map = found.clone().narrow(0, 0, of.len()).reshape([pictures, of.height, of.width, of.channels]);
    let mut at = of.len();
    let statistics = sizes.iter().map(|layer| {
        let mut next = || {
            at += layer.to.channels;
            found.clone().narrow(0, at - layer.to.channels, layer.to.channels).detach()
        };
        [next(), next()]
    });
    Normalised { statistics: statistics.collect(), map: map.permute([0, 3, 1, 2]) }
}

/// The size of a map: so many numbers at each pixel of each picture.
#[derive(Clone, Copy, Debug)]
struct Map {
    pictures: usize,
    height: usize,
    width: usize,
    channels: usize,
}

impl Map {
    /// What a convolution of stride 2 with a padding of 1 leaves.
    fn halved(&self, channels: usize) -> Self {
        Self { height: self.height.div_ceil(STRIDE), width: self.width.div_ceil(STRIDE), channels, ..*self }
    }

    /// Pixels of a picture.
    fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// Numbers of a picture.
    fn picture(&self) -> usize {
        self.pixels() * self.channels
    }

    fn len(&self) -> usize {
        self.pictures * self.picture()
    }
}

/// A convolution and its normalisation.
#[derive(Clone, Copy, Debug)]
struct Layer {
    of: Map,
    to: Map,
    epsilon: f32,
}

impl Layer {
    /// Numbers of a neighbourhood.
    fn seen(&self) -> usize {
        TAPS * self.of.channels
    }

    fn weights(&self) -> usize {
        self.seen() * self.to.channels
    }

    /// Weights, factors and offsets.
    fn parameters(&self) -> usize {
        self.weights() + 2 * self.to.channels
    }

    /// Calls `each` with where a weight lies in burn's order, by output, input and place, and where in a matrix
    /// `[neighbourhood, outputs]`: cache line by cache line of the latter.
    fn places(&self, mut each: impl FnMut(usize, usize)) {
        let (inputs, outputs) = (self.of.channels, self.to.channels);
        for first in (0..outputs).step_by(LINE) {
            for place in 0..self.seen() {
                let (input, tap) = (place / TAPS, place % TAPS);
                for output in first..(first + LINE).min(outputs) {
                    each(output * self.seen() + place, (tap * inputs + input) * outputs + output);
                }
            }
        }
    }

    /// Weights in the order of the matrix.
    fn reordered(&self, weights: &[f32]) -> Vec<f32> {
        let mut reordered = vec![0.0; self.weights()];
        self.places(|at, to| reordered[to] = weights[at]);
        reordered
    }

    /// Pictures whose neighbourhoods are written down at a time.
    fn group(&self) -> usize {
        (NEIGHBOURHOODS / (self.to.pixels() * self.seen())).clamp(1, self.of.pictures.max(1))
    }

    /// im2col: writes the neighbourhood of each pixel of some pictures, a row each, zero beyond the border.
    fn im2col(&self, pictures: &[f32], rows: &mut [f32]) {
        let Map { height, width, channels, .. } = self.of;
        let by_row = self.to.width * self.seen();
        rows.par_chunks_mut(by_row).enumerate().for_each(|(row, out)| {
            let (picture, y) = (row / self.to.height, row % self.to.height);
            let picture = &pictures[picture * self.of.picture()..][..self.of.picture()];
            for (place, out) in out.chunks_exact_mut(channels).enumerate() {
                let (x, dy, dx) = (place / TAPS, place % TAPS / KERNEL, place % KERNEL);
                let (y, x) = (STRIDE * y + dy, STRIDE * x + dx);
                if (1..=height).contains(&y) && (1..=width).contains(&x) {
                    out.copy_from_slice(&picture[((y - 1) * width + x - 1) * channels..][..channels]);
                } else {
                    out.fill(0.0);
                }
            }
        });
    }

    /// Its transpose: adds up at each pixel of some pictures what neighbourhoods have of it.
    fn col2im(&self, rows: &[f32], pictures: &mut [f32]) {
        let Map { height, width, channels, .. } = self.of;
        let by_picture = self.to.pixels() * self.seen();
        pictures.par_chunks_mut(self.of.picture()).zip(rows.par_chunks(by_picture)).for_each(|(picture, rows)| {
            for (place, row) in rows.chunks_exact(channels).enumerate() {
                let (pixel, dy, dx) = (place / TAPS, place % TAPS / KERNEL, place % KERNEL);
                let (y, x) = (STRIDE * (pixel / self.to.width) + dy, STRIDE * (pixel % self.to.width) + dx);
                if (1..=height).contains(&y) && (1..=width).contains(&x) {
                    let sum = &mut picture[((y - 1) * width + x - 1) * channels..][..channels];
                    sum.iter_mut().zip(row).for_each(|(sum, row)| *sum += row);
                }
            }
        });
    }

    /// The convolution.
    fn convolve(&self, weights: &[f32], input: &[f32]) -> Vec<f32> {
        let (group, channels) = (self.group(), self.to.channels);
        let mut seen = vec![0.0; group * self.to.pixels() * self.seen()];
        let mut out = vec![0.0; self.to.len()];
        let weights = matrix(weights, self.seen(), channels);
        for (input, out) in input.chunks(group * self.of.picture()).zip(out.chunks_mut(group * self.to.picture())) {
            let pixels = out.len() / channels;
            let seen = &mut seen[..pixels * self.seen()];
            self.im2col(input, seen);
            let share = share(pixels);
            out.par_chunks_mut(share * channels).zip(seen.par_chunks(share * self.seen())).for_each(|(out, seen)| {
                let pixels = out.len() / channels;
                let seen = matrix(seen, pixels, self.seen());
                general_mat_mul(1.0, &seen, &weights, 0.0, &mut matrix_mut(out, pixels, channels));
            });
        }
        out
    }

    /// The gradients by weights, in the order of [`Layer::reordered`], and by the input where it is asked for, given that by the
    /// convolution.
    fn convolve_back(&self, weights: &[f32], input: &[f32], by: &[f32], by_input: Option<&mut [f32]>) -> Vec<f32> {
        let (group, channels) = (self.group(), self.to.channels);
        let mut seen = vec![0.0; group * self.to.pixels() * self.seen()];
        let mut by_weights = vec![0.0; self.weights()];
        let weights = matrix(weights, self.seen(), channels);
        let mut by_input = by_input.map(|by_input| by_input.chunks_mut(group * self.of.picture()));
        for (input, by) in input.chunks(group * self.of.picture()).zip(by.chunks(group * self.to.picture())) {
            let pixels = by.len() / channels;
            let seen = &mut seen[..pixels * self.seen()];
            self.im2col(input, seen);
            // Rows of the weights are shared out, so that no sum depends on how many threads there are.
            let (share_of_rows, all, of_all) = (share(self.seen()), matrix(seen, pixels, self.seen()), by);
            let of_all = matrix(of_all, pixels, channels);
            by_weights.par_chunks_mut(share_of_rows * channels).enumerate().for_each(|(part, by_weights)| {
                let (first, rows) = (part * share_of_rows, by_weights.len() / channels);
                let seen = all.slice(s![.., first..first + rows]);
                general_mat_mul(1.0, &seen.t(), &of_all, 1.0, &mut matrix_mut(by_weights, rows, channels));
            });
            let Some(by_input) = by_input.as_mut().and_then(Iterator::next) else { continue };
            let share = share(pixels);
            seen.par_chunks_mut(share * self.seen()).zip(by.par_chunks(share * channels)).for_each(|(seen, by)| {
                let pixels = by.len() / channels;
                let by = matrix(by, pixels, channels);
                general_mat_mul(1.0, &by, &weights.t(), 0.0, &mut matrix_mut(seen, pixels, self.seen()));
            });
            self.col2im(seen, by_input);
        }
        by_weights
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
        let channels = layer.to.channels;
        let (weights, affine) = parameters.split_at(layer.weights());
        let (gamma, beta) = affine.split_at(channels);
        let convolved = layer.convolve(&layer.reordered(weights), input);
        let count = (convolved.len() / channels).max(1) as f64;
        let sum = sums(&convolved, channels, |value, _| f64::from(value));
        let mean: Vec<f32> = sum.iter().map(|sum| (sum / count) as f32).collect();
        let squares = sums(&convolved, channels, |value, channel| f64::from(value - mean[channel]).powi(2));
        let variance: Vec<f32> = squares.iter().map(|sum| (sum / count) as f32).collect();
        let factors: Vec<f32> = (0..channels).map(|c| gamma[c] / (variance[c] + layer.epsilon).sqrt()).collect();
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
        let channels = layer.to.channels;
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

/// The function. Its value is the last map, pixel by pixel, and behind it mean and variance of each layer's channels.
#[derive(Debug)]
struct Convolutions {
    layers: Vec<Layer>,
    /// The pictures.
    pixels: Vec<f32>,
    /// What the layers made, for the way back.
    passes: OnceLock<Vec<Passed>>,
}

impl Convolutions {
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

impl HostFunction for Convolutions {
    fn value(&self, inputs: &[f32]) -> Vec<f32> {
        let passes = self.passes(inputs);
        let mut value = passes.last().map_or_else(|| self.pixels.clone(), |passed| passed.map.clone());
        passes.iter().for_each(|passed| value.extend(passed.mean.iter().chain(&passed.variance)));
        value
    }

    fn gradient(&self, inputs: &[f32], by: &[f32]) -> Vec<f32> {
        let passes = self.passes(inputs);
        let mut gradient = vec![0.0; inputs.len()];
        let mut end = inputs.len();
        let mut by = by[..passes.last().map_or(0, |passed| passed.map.len())].to_vec();
        for (i, (layer, passed)) in self.layers.iter().zip(passes).enumerate().rev() {
            let own = end - layer.parameters()..end;
            end = own.start;
            let (weights, affine) = inputs[own.clone()].split_at(layer.weights());
            let channels = layer.to.channels;
            let [by_gamma, by_beta] = passed.normalise_back(layer, &affine[..channels], &mut by);
            let input = if i > 0 { &passes[i - 1].map } else { &self.pixels };
            let mut by_input = if i > 0 { vec![0.0; layer.of.len()] } else { Vec::new() };
            let asked = (i > 0).then_some(&mut by_input[..]);
            let by_weights = layer.convolve_back(&layer.reordered(weights), input, &by, asked);
            let (of_weights, of_affine) = gradient[own].split_at_mut(layer.weights());
            layer.places(|at, from| of_weights[at] = by_weights[from]);
            of_affine[..channels].copy_from_slice(&by_gamma);
            of_affine[channels..].copy_from_slice(&by_beta);
            by = by_input;
        }
        gradient
    }
}

/// Rows of a product for each thread.
fn share(rows: usize) -> usize {
    rows.div_ceil(rayon::current_num_threads()).max(1)
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

    /// The last map, gradients by all parameters, and what the running statistics are then.
    fn found(encoder: &ConvolutionalBn, map: Tensor<4>) -> Vec<Vec<f32>> {
        let [.., height, width] = map.dims();
        let places: Vec<f32> = (0..map.dims().iter().product()).map(|i: usize| (1.3 * i as f32).cos()).collect();
        let weights = Tensor::from_data(TensorData::new(places, map.dims()), &map.device());
        assert!(height > 0 && width > 0);
        let gradients = (map.clone() * weights).sum().backward();
        let mut all = vec![numbers(map)];
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
        for size in [[64, 64], [21, 50]] {
            let images = images(size, &device);
            // Clones share their running statistics.
            let new = || seeded(&device, 5, || ConvolutionalBn::new(4, 6, &device));
            let (of_burn, own) = (new(), new());
            let map = of_burn.layers.iter().fold(images.clone(), |net, layer| layer.forward(net));
            let expected = found(&of_burn, map);
            let Normalised { map, statistics } = normalised_convolutions(images, &own.layers);
            own.layers.iter().zip(statistics).for_each(|(layer, [mean, variance])| layer.remember(mean, variance));
            let ours = found(&own, map);
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
                found(&encoder, normalised_convolutions(images([32, 32], &device), &encoder.layers).map)
            })
        };
        assert!(with(1) == with(3));
    }

    #[test]
    fn what_is_no_number_is_not_hidden() {
        let device = Device::flex().autodiff();
        let encoder = seeded(&device, 5, || ConvolutionalBn::new(4, 6, &device));
        let map = normalised_convolutions(images([32, 32], &device) * f32::NAN, &encoder.layers).map;
        assert!(numbers(map).iter().all(|value| value.is_nan()));
    }
}
