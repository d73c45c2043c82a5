//! Convolutions on the CPU, and back.
//!
//! Pictures lie pixel by pixel, all channels of a pixel side by side: what a convolution sees of a pixel's neighbourhood is then
//! a row of a matrix, and the convolution a product.

use ndarray::linalg::general_mat_mul;
use ndarray::s;
use rayon::prelude::*;

use crate::matrices::{matrix, matrix_mut};

/// Pixels along an edge of what a convolution sees.
const KERNEL: usize = 3;

/// Places of a kernel.
const TAPS: usize = KERNEL * KERNEL;

/// Numbers of a cache line.
const LINE: usize = 16;

/// Numbers of neighbourhoods that are written down at a time, at most: 16 MiB.
const NEIGHBOURHOODS: usize = 1 << 22;

/// The size of a map: so many numbers at each pixel of each picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Map {
    pub pictures: usize,
    pub height: usize,
    pub width: usize,
    pub channels: usize,
}

impl Map {
    /// Pixels of a picture.
    fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// Numbers of a picture.
    fn picture(&self) -> usize {
        self.pixels() * self.channels
    }

    pub fn len(&self) -> usize {
        self.pictures * self.picture()
    }
}

/// A convolution of pictures that lie pixel by pixel, 3x3 with a padding of 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Convolution {
    pub of: Map,
    pub to: Map,
    /// From one place of the kernel to the next.
    stride: usize,
}

impl Convolution {
    /// To so many channels.
    pub fn new(of: Map, channels: usize, stride: usize) -> Self {
        let to = Map { height: of.height.div_ceil(stride), width: of.width.div_ceil(stride), channels, ..of };
        Self { of, to, stride }
    }

    /// Numbers of a neighbourhood.
    fn seen(&self) -> usize {
        TAPS * self.of.channels
    }

    pub fn weights(&self) -> usize {
        self.seen() * self.to.channels
    }

    /// Calls `each` with where a weight lies in burn's order, by output, input and place, and where in a matrix
    /// `[neighbourhood, outputs]`: cache line by cache line of the latter.
    pub fn places(&self, mut each: impl FnMut(usize, usize)) {
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
    pub fn reordered(&self, weights: &[f32]) -> Vec<f32> {
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
                let (y, x) = (self.stride * y + dy, self.stride * x + dx);
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
                let (y, x) = (self.stride * (pixel / self.to.width) + dy, self.stride * (pixel % self.to.width) + dx);
                if (1..=height).contains(&y) && (1..=width).contains(&x) {
                    let sum = &mut picture[((y - 1) * width + x - 1) * channels..][..channels];
                    sum.iter_mut().zip(row).for_each(|(sum, row)| *sum += row);
                }
            }
        });
    }

    /// The convolution.
    pub fn convolve(&self, weights: &[f32], input: &[f32]) -> Vec<f32> {
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
    pub fn convolve_back(&self, weights: &[f32], input: &[f32], by: &[f32], by_input: Option<&mut [f32]>) -> Vec<f32> {
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

/// Rows of a product for each thread.
fn share(rows: usize) -> usize {
    rows.div_ceil(rayon::current_num_threads()).max(1)
}
