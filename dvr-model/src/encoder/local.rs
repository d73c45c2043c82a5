//! An encoder whose features stay where they are in the picture.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Initializer, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::Camera;

use super::convolutional::Convolutional;
use super::pooling::global_mean;
use crate::picture_camera::{CAMERA_NUMBERS, camera_numbers, camera_of_numbers};
use crate::pixel_aligned::PixelAligned;

/// Maps of the convolutions that go into the plane; that of the last is as good as a single place.
const MAPS: usize = 4;

/// Width of the hidden layer from features to cameras.
const CAMERA_WIDTH: usize = 128;

/// The small convolutional encoder; the features of its layers beside the code that is made of them, brought to the resolution
/// of the first and added (a feature pyramid, Lin et al. 2017), for decoders that look them up where a point lies in the picture
/// (Saito et al. 2019, PIFu); and a guess of the camera, for pictures whose camera is not known (as Xu et al. 2019, DISN).
#[derive(Module, Debug)]
pub struct Local {
    /// Makes the code.
    pub convolutional: Convolutional,
    /// From each of its maps, the finest first, to the channels of the plane; 1x1.
    pub laterals: Vec<Conv2d>,
    /// Over their sum, 3x3.
    pub smooth: Conv2d,
    /// Features to the guess of the camera, hidden.
    pub camera0: Linear,
    /// To its numbers.
    pub camera1: Linear,
}

/// What the encoder makes of pictures.
pub struct LocalFeatures {
    /// Codes `[b, code_dim]`.
    pub codes: Tensor<2>,
    /// The plane `[b, channels, n, n]`, see [`Local::plane_index`].
    pub plane: Tensor<4>,
    /// Guesses of the cameras as numbers, `[b, CAMERA_NUMBERS]`.
    pub cameras: Tensor<2>,
}

impl Local {
    /// Random parameters: a plane of `channels` features.
    pub fn new(width: usize, channels: usize, code_dim: usize, device: &Device) -> Self {
        let initializer = Initializer::KaimingUniform { gain: f64::sqrt(2.0), fan_out_only: false };
        let convolution = |input, kernel: usize| {
            let pad = kernel / 2;
            Conv2dConfig::new([input, channels], [kernel; 2])
                .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
                .with_initializer(initializer.clone())
                .init(device)
        };
        Self {
            convolutional: Convolutional::new(width, code_dim, device),
            laterals: (0..MAPS).map(|map| convolution(width << map, 1)).collect(),
            smooth: convolution(channels, 3),
            camera0: LinearConfig::new(16 * width, CAMERA_WIDTH).with_initializer(initializer.clone()).init(device),
            camera1: LinearConfig::new(CAMERA_WIDTH, CAMERA_NUMBERS).init(device),
        }
    }

    /// Channels of the plane.
    pub fn channels(&self) -> usize {
        self.smooth.weight.dims()[0]
    }

    /// Codes, plane and guessed cameras of images `[b, 3, size, size]`, sRGB in `[0, 1]`.
    pub fn forward(&self, images: Tensor<4>) -> LocalFeatures {
        let device = images.device();
        let maps = self.convolutional.maps(images);
        let side = maps[0].dims()[3];
        let lateral = |k: usize| self.laterals[k].forward(relu(maps[k].clone()));
        let plane = (1..MAPS).fold(lateral(0), |sum, k| sum + enlarged(lateral(k), k, side, &device));
        let features = relu(global_mean(maps[4].clone()));
        LocalFeatures {
            codes: self.convolutional.code(features.clone()),
            plane: self.smooth.forward(relu(plane)),
            cameras: self.camera1.forward(relu(self.camera0.forward(features))),
        }
    }

    /// The plane with the cameras of its pictures, in object space, guessed where they are not known; the codes; and how far the
    /// guesses are off, where that is known.
    pub(crate) fn aligned(
        &self,
        images: Tensor<4>,
        cameras: Option<&[Camera]>,
    ) -> (PixelAligned, Tensor<2>, Option<Tensor<1>>) {
        let size = images.dims()[3];
        let device = images.device();
        let LocalFeatures { codes, plane, cameras: guessed } = self.forward(images);
        let index = Self::plane_index(size);
        match cameras {
            Some(cameras) => {
                let error = Self::camera_error(guessed, cameras);
                (PixelAligned::new(plane, index, cameras, &device), codes, Some(error))
            }
            None => {
                let numbers: Vec<f32> = guessed.into_data().iter::<f32>().collect();
                let cameras: Vec<Camera> =
                    numbers.chunks(CAMERA_NUMBERS).map(|of_one| camera_of_numbers(of_one, size as u32)).collect();
                (PixelAligned::new(plane, index, &cameras, &device), codes, None)
            }
        }
    }

    /// Where a place in a picture, from 0 to 1 along an edge of `size` pixels, lies in the plane: columns or rows, the middle of
    /// the first being 0. The first convolution has 3 taps, stride 2 and no padding.
    pub fn plane_index(size: usize) -> [f64; 2] {
        // Pixel 2 i + 1 is the middle of what column i sees.
        [0.5 * size as f64, -0.75]
    }

    /// How far guessed cameras, `[b, CAMERA_NUMBERS]`, are from the true ones: the mean square of their numbers, `[1]`.
    pub fn camera_error(guessed: Tensor<2>, cameras: &[Camera]) -> Tensor<1> {
        let numbers: Vec<f32> = cameras.iter().flat_map(camera_numbers).collect();
        let numbers = TensorData::new(numbers, [cameras.len(), CAMERA_NUMBERS]);
        (guessed.clone() - Tensor::from_data(numbers, &guessed.device())).square().mean()
    }
}

/// A map of convolution `k` at the places of that of the first, `[b, c, side, side]`, between which it is interpolated.
fn enlarged(map: Tensor<4>, k: usize, side: usize, device: &Device) -> Tensor<4> {
    let [_, _, _, n] = map.dims();
    let (scale, first) = ((1u32 << k) as f32, ((1u32 << k) - 1) as f32);
    let mut weights = vec![0f32; side * n];
    for (row, weights) in weights.chunks_mut(n).enumerate() {
        let at = ((row as f32 - first) / scale).clamp(0.0, (n - 1) as f32);
        let low = (at as usize).min(n.saturating_sub(2));
        let share = at - low as f32;
        weights[low] += 1.0 - share;
        if let Some(next) = weights.get_mut(low + 1) {
            *next += share;
        }
    }
    let rows = Tensor::<2>::from_data(TensorData::new(weights, [side, n]), device);
    let columns = rows.clone().transpose().unsqueeze::<4>();
    rows.unsqueeze::<4>().matmul(map).matmul(columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn enlarged_maps_lie_where_the_finest_does() {
        let device = Device::flex();
        // A map whose values are the places of its pixels in the picture, as convolutions without padding see them.
        let ramp = |k: usize, n: usize| -> Vec<f32> {
            (0..n * n).map(|i| (((i % n) << (k + 1)) + (2 << k) - 1) as f32).collect()
        };
        for (k, n) in [(1, 15), (2, 7), (3, 3)] {
            let map = Tensor::<4>::from_data(TensorData::new(ramp(k, n), [1, 1, n, n]), &device);
            let found: Vec<f32> = enlarged(map, k, 31, &device).into_data().iter::<f32>().collect();
            let expected = ramp(0, 31);
            let (first, last) = (ramp(k, n)[0], ramp(k, n)[n - 1]);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected.clamp(first, last)).abs() < 1e-3, "{k}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_place_in_the_picture_is_found_in_the_plane() {
        // The middle of pixel 1 is what the first column of the plane sees, that of pixel 61 what the last of 31 does.
        let [scale, shift] = Local::plane_index(64);
        assert_eq!([1.5, 61.5].map(|pixel| pixel / 64.0 * scale + shift), [0.0, 30.0]);
    }

    #[test]
    fn pictures_become_codes_planes_and_cameras() {
        let device = Device::flex();
        let local = Local::new(2, 5, 7, &device);
        let made = local.forward(Tensor::ones([3, 3, 64, 64], &device));
        assert_eq!((made.codes.dims(), made.plane.dims()), ([3, 7], [3, 5, 31, 31]));
        assert_eq!((made.cameras.dims(), local.channels()), ([3, CAMERA_NUMBERS], 5));
    }
}
