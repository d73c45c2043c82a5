//! An encoder whose features stay where they are in the picture.

use burn::module::Module;
use burn::nn::conv::{Conv2d, Conv2dConfig};
use burn::nn::{Initializer, Linear, LinearConfig, PaddingConfig2d};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use dvr_core::Camera;

use super::convolutional::Convolutional;
use super::convolutional_bn::ConvolutionalBn;
use super::convolved::convolved;
use super::pooling::global_mean;
use crate::host_function::is_on_host;
use crate::picture_camera::{CAMERA_NUMBERS, camera_numbers, camera_of_numbers};
use crate::pixel_aligned::PixelAligned;

/// Maps of the convolutions that go into the plane; that of the last is as good as a single place.
const MAPS: usize = 4;

/// Width of the hidden layer from features to cameras.
const CAMERA_WIDTH: usize = 128;

/// A small convolutional encoder; the features of its layers beside the code that is made of them, brought to the resolution
/// of the first and added (a feature pyramid, Lin et al. 2017), for decoders that look them up where a point lies in the picture
/// (Saito et al. 2019, PIFu); and a guess of the camera, for pictures whose camera is not known (as Xu et al. 2019, DISN).
#[derive(Module, Debug)]
pub struct Local {
    /// Makes the code.
    pub convolutional: Convolutions,
    /// From each of its maps, the finest first, to the channels of the plane; 1x1.
    pub laterals: Vec<Conv2d>,
    /// Over their sum, 3x3.
    pub smooth: Conv2d,
    /// Features to the guess of the camera, hidden.
    pub camera0: Linear,
    /// To its numbers.
    pub camera1: Linear,
}

/// The convolutions of a [`Local`] encoder.
#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant)] // there is one per model, and burn's modules take no box
pub enum Convolutions {
    /// As they are.
    Plain(Convolutional),
    /// With batch normalisation.
    Normalised(ConvolutionalBn),
}

/// What convolutions make of pictures.
struct Convolved {
    /// Behind each of the first [`MAPS`] layers, the finest first.
    maps: Vec<Tensor<4>>,
    /// What the code is made of, `[b, features]`.
    features: Tensor<2>,
}

impl Convolutions {
    fn forward(&self, images: Tensor<4>) -> Convolved {
        match self {
            Self::Plain(layers) => {
                let [maps @ .., last] = layers.maps(images).map(relu);
                Convolved { maps: maps.into(), features: relu(global_mean(last)) }
            }
            Self::Normalised(layers) => {
                let mut maps = layers.maps(images, 0);
                let last = maps.pop().expect("there are layers");
                Convolved { maps, features: ConvolutionalBn::places(last) }
            }
        }
    }

    fn code(&self, features: Tensor<2>) -> Tensor<2> {
        match self {
            Self::Plain(layers) => layers.code(features),
            Self::Normalised(layers) => layers.fc.forward(features),
        }
    }

    /// Numbers that the code is made of.
    fn features(&self) -> usize {
        match self {
            Self::Plain(layers) => layers.fc_out.weight.dims()[0],
            Self::Normalised(layers) => layers.fc.weight.dims()[0],
        }
    }

    /// Where the first column of map `k` lies among those of the finest: without padding, each map begins where its first kernel
    /// has its middle.
    fn first_column(&self, k: usize) -> usize {
        match self {
            Self::Plain(_) => (1 << k) - 1,
            Self::Normalised(_) => 0,
        }
    }
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
    /// Random parameters: a plane of `channels` features, of convolutions with this many channels in the first layer.
    pub fn new(convolutional: Convolutions, width: usize, channels: usize, device: &Device) -> Self {
        let initializer = Initializer::KaimingUniform { gain: f64::sqrt(2.0), fan_out_only: false };
        let convolution = |input, kernel: usize| {
            let pad = kernel / 2;
            Conv2dConfig::new([input, channels], [kernel; 2])
                .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
                .with_initializer(initializer.clone())
                .init(device)
        };
        Self {
            laterals: (0..MAPS).map(|map| convolution(width << map, 1)).collect(),
            smooth: convolution(channels, 3),
            camera0: LinearConfig::new(convolutional.features(), CAMERA_WIDTH)
                .with_initializer(initializer.clone())
                .init(device),
            camera1: LinearConfig::new(CAMERA_WIDTH, CAMERA_NUMBERS).init(device),
            convolutional,
        }
    }

    /// Channels of the plane.
    pub fn channels(&self) -> usize {
        self.smooth.weight.dims()[0]
    }

    /// Codes `[b, code_dim]` alone.
    pub(super) fn codes(&self, images: Tensor<4>) -> Tensor<2> {
        self.convolutional.code(self.convolutional.forward(images).features)
    }

    /// Codes, plane and guessed cameras of images `[b, 3, size, size]`, sRGB in `[0, 1]`.
    pub fn forward(&self, images: Tensor<4>) -> LocalFeatures {
        let device = images.device();
        let Convolved { maps, features } = self.convolutional.forward(images);
        let side = maps[0].dims()[3];
        let lateral = |k: usize| self.laterals[k].forward(maps[k].clone());
        let enlarged = |k: usize| enlarged(lateral(k), k, self.convolutional.first_column(k), side, &device);
        let plane = (1..MAPS).fold(lateral(0), |sum, k| sum + enlarged(k));
        LocalFeatures {
            codes: self.convolutional.code(features.clone()),
            plane: self.smoothed(relu(plane)),
            cameras: self.camera1.forward(relu(self.camera0.forward(features))),
        }
    }

    fn smoothed(&self, plane: Tensor<4>) -> Tensor<4> {
        let by_hand = is_on_host(&self.smooth.weight.val());
        if by_hand { convolved(plane, &self.smooth) } else { self.smooth.forward(plane) }
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
        let index = self.plane_index(size);
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
    /// the first being 0. The first convolution has 3 taps and stride 2.
    pub fn plane_index(&self, size: usize) -> [f64; 2] {
        let shift = match self.convolutional {
            // Pixel 2 i + 1 is the middle of what column i sees.
            Convolutions::Plain(_) => -0.75,
            // With a padding of 1, pixel 2 i is.
            Convolutions::Normalised(_) => -0.25,
        };
        [0.5 * size as f64, shift]
    }

    /// How far guessed cameras, `[b, CAMERA_NUMBERS]`, are from the true ones: the mean square of their numbers, `[1]`.
    pub fn camera_error(guessed: Tensor<2>, cameras: &[Camera]) -> Tensor<1> {
        let numbers: Vec<f32> = cameras.iter().flat_map(camera_numbers).collect();
        let numbers = TensorData::new(numbers, [cameras.len(), CAMERA_NUMBERS]);
        (guessed.clone() - Tensor::from_data(numbers, &guessed.device())).square().mean()
    }
}

/// A map of convolution `k`, whose first column lies at column `first` of that of the first convolution, at the places of the latter,
/// `[b, c, side, side]`, between which it is interpolated.
fn enlarged(map: Tensor<4>, k: usize, first: usize, side: usize, device: &Device) -> Tensor<4> {
    let [_, _, _, n] = map.dims();
    let (scale, first) = ((1u32 << k) as f32, first as f32);
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

    fn plain(width: usize, code_dim: usize, device: &Device) -> Convolutions {
        Convolutions::Plain(Convolutional::new(width, code_dim, device))
    }

    fn normalised(width: usize, code_dim: usize, device: &Device) -> Convolutions {
        Convolutions::Normalised(ConvolutionalBn::new(width, code_dim, device))
    }

    /// How the convolutions of a kind see a picture of 64 pixels.
    struct Kind {
        made: fn(usize, usize, &Device) -> Convolutions,
        /// Columns of the maps, the finest first.
        sides: [usize; MAPS],
        /// The pixel in the middle of what the first column of a map sees.
        first_pixel: fn(usize) -> usize,
    }

    const KINDS: [Kind; 2] = [
        Kind { made: plain, sides: [31, 15, 7, 3], first_pixel: |k| (2 << k) - 1 },
        Kind { made: normalised, sides: [32, 16, 8, 4], first_pixel: |_| 0 },
    ];

    #[test]
    fn enlarged_maps_lie_where_the_finest_does() {
        let device = Device::flex();
        for Kind { made, sides, first_pixel } in KINDS {
            let convolutions = made(2, 4, &device);
            // A map whose values are the places of its pixels in the picture, as convolutions see them.
            let ramp = |k: usize| -> Vec<f32> {
                let n = sides[k];
                (0..n * n).map(|i| (((i % n) << (k + 1)) + first_pixel(k)) as f32).collect()
            };
            let expected = ramp(0);
            for (k, &n) in sides.iter().enumerate().skip(1) {
                let map = Tensor::<4>::from_data(TensorData::new(ramp(k), [1, 1, n, n]), &device);
                let enlarged = enlarged(map, k, convolutions.first_column(k), sides[0], &device);
                let found: Vec<f32> = enlarged.into_data().iter::<f32>().collect();
                let (first, last) = (ramp(k)[0], ramp(k)[n - 1]);
                assert_eq!(found.len(), expected.len());
                for (found, expected) in found.iter().zip(&expected) {
                    assert!((found - expected.clamp(first, last)).abs() < 1e-3, "{k}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_place_in_the_picture_is_found_in_the_plane() {
        for Kind { made, sides, first_pixel } in KINDS {
            let local = Local::new(made(2, 4, &Device::flex()), 2, 4, &Device::flex());
            let [scale, shift] = local.plane_index(64);
            let column = |pixel: usize| (pixel as f64 + 0.5) / 64.0 * scale + shift;
            let last = sides[0] - 1;
            assert_eq!([first_pixel(0), first_pixel(0) + 2 * last].map(column), [0.0, last as f64]);
        }
    }

    #[test]
    fn pictures_become_codes_planes_and_cameras() {
        let device = Device::flex();
        for Kind { made, sides, .. } in KINDS {
            let local = Local::new(made(2, 7, &device), 2, 5, &device);
            let made = local.forward(Tensor::ones([3, 3, 64, 64], &device));
            assert_eq!((made.codes.dims(), made.plane.dims()), ([3, 7], [3, 5, sides[0], sides[0]]));
            assert_eq!((made.cameras.dims(), local.channels()), ([3, CAMERA_NUMBERS], 5));
        }
    }

    #[test]
    fn a_shift_of_the_picture_shifts_the_plane() {
        // The places of features are those of what they show: a picture shifted by two pixels has the plane shifted by a column.
        let device = Device::flex();
        for Kind { made, .. } in KINDS {
            let local = Local::new(made(2, 4, &device), 2, 3, &device);
            let spot = |column: usize| {
                let mut pixels = vec![0f32; 3 * 64 * 64];
                (0..3).for_each(|channel| pixels[channel * 4096 + 30 * 64 + column] = 1.0);
                let image = Tensor::<4>::from_data(TensorData::new(pixels, [1, 3, 64, 64]), &device);
                // The finest map alone: those of the others move by whole columns of theirs.
                local.convolutional.forward(image).maps[0].clone()
            };
            let (here, there) = (spot(30), spot(32));
            let columns = here.dims()[3] - 1;
            let apart = (here.narrow(3, 0, columns) - there.narrow(3, 1, columns)).abs().max().into_scalar::<f32>();
            assert!(apart < 1e-5, "{apart}");
        }
    }
}
