//! The model of many objects: an encoder that makes codes and the decoder that they condition.

use burn::module::Module;
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::{Device, Int, Tensor};
use dvr_core::Camera;
use dvr_core::number_range::{NumberRange, OutOfRange, check_config, nested};
use serde::{Deserialize, Serialize};

use crate::conditioned::Conditioned;
use crate::decoder::{Decoder, DecoderConfig};
use crate::encoder::{Encoder, EncoderConfig};
use crate::pixel_aligned::PixelAligned;

/// Configuration of an [`ImageModel`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageModelConfig {
    /// What makes the codes.
    pub encoder: EncoderConfig,
    /// What they condition; its `code_dim` is the codes' length for both.
    pub decoder: DecoderConfig,
}

impl Default for ImageModelConfig {
    /// The paper's: a ResNet-18, codes of length 256 and a decoder of width 512.
    fn default() -> Self {
        Self { encoder: EncoderConfig::default(), decoder: DecoderConfig::new().with_code_dim(256).with_hidden(512) }
    }
}

impl ImageModelConfig {
    /// The range of every number.
    pub fn ranges() -> Vec<NumberRange> {
        [nested("encoder", EncoderConfig::RANGES), nested("decoder", DecoderConfig::RANGES)].concat()
    }

    /// Checks that a model can be made of it.
    ///
    /// # Errors
    /// Names the first value that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_config(self, &Self::ranges())?;
        let code_dim = self.decoder.code_dim;
        if code_dim == 0 {
            return Err(OutOfRange::new("decoder.code_dim", code_dim, "at least 1 (the paper's is 256)"));
        }
        self.encoder.check_image_size()
    }

    /// How many numbers the model has at least.
    pub fn parameters(&self) -> u64 {
        let aligned = match self.encoder {
            EncoderConfig::Local { channels, .. } => {
                (channels as u64).saturating_add(3).saturating_mul(self.decoder.hidden as u64)
            }
            _ => 0,
        };
        let encoder = self.encoder.parameters(self.decoder.code_dim);
        self.decoder.parameters().saturating_add(encoder).saturating_add(aligned)
    }

    /// A model with fresh parameters.
    pub fn init(&self, device: &Device) -> ImageModel {
        let encoder = self.encoder.init(self.decoder.code_dim, device);
        let aligned = match &encoder {
            Encoder::Local(local) => Some(AlignedLayer::new(local.channels(), self.decoder.hidden, device)),
            Encoder::Resnet18(_) | Encoder::Convolutional(_) | Encoder::ConvolutionalBn(_) | Encoder::Codes(_) => None,
        };
        ImageModel { encoder, decoder: self.decoder.init(device), aligned }
    }
}

/// An encoder and a decoder, with the parameter names of the checkpoints of DVR's reference code.
#[derive(Module, Debug)]
pub struct ImageModel {
    /// Makes the codes.
    pub encoder: Encoder,
    /// Makes occupancy and colour of a point and a code.
    pub decoder: Decoder,
    /// What the decoder's first layer takes of the picture where a point lies in it, with [`Encoder::Local`].
    pub aligned: Option<AlignedLayer>,
}

/// From features of a place in a picture, and the place of the point as seen by the camera, to the decoder's first layer.
#[derive(Module, Debug)]
pub struct AlignedLayer {
    /// Features to hidden, `[channels, hidden]`; starts at zero, so that the decoder starts without them.
    pub features: Linear,
    /// The point in the camera's axes to hidden, `[3, hidden]`.
    pub place: Linear,
}

impl AlignedLayer {
    fn new(channels: usize, hidden: usize, device: &Device) -> Self {
        let place = LinearConfig::new(3, hidden).with_bias(false).init(device);
        let weight = Initializer::Zeros.init([channels, hidden], device);
        Self { features: Linear { weight, bias: None }, place }
    }
}

/// What a model sees in pictures.
pub struct Seen {
    /// The field of their objects; a query's object index picks one.
    pub field: Conditioned,
    /// How far the cameras that the encoder guesses are from those that are known, `[1]`; `None` where it guesses none.
    pub camera_error: Option<Tensor<1>>,
}

impl ImageModel {
    /// Codes `[b, code_dim]` of a batch of objects; see [`Encoder::forward`].
    pub fn codes(&self, images: Tensor<4>, objects: Tensor<1, Int>) -> Tensor<2> {
        self.encoder.forward(images, objects)
    }

    /// The field of objects with these codes, `[b, code_dim]`, alone, without what [`ImageModel::see`] takes of the pictures; a
    /// query's object index picks the row.
    pub fn field(&self, codes: Tensor<2>) -> Conditioned {
        self.decoder.with_codes(codes)
    }

    /// The field of a batch of objects; see [`Encoder::forward`].
    ///
    /// `cameras` are those of the images, one each, in object space; without them, encoders that need them guess them.
    pub fn see(&self, images: Tensor<4>, objects: Tensor<1, Int>, cameras: Option<&[Camera]>) -> Seen {
        let (Encoder::Local(local), Some(layer)) = (&self.encoder, &self.aligned) else {
            return Seen { field: self.field(self.codes(images, objects)), camera_error: None };
        };
        let (aligned, codes, camera_error) = local.aligned(images, cameras);
        let (weight, place) = (layer.features.weight.val(), layer.place.weight.val());
        let aligned = AlignedFeatures { planes: aligned.map(|rows| rows.matmul(weight)), place };
        Seen { field: self.field(codes).with_aligned(Some(aligned)), camera_error }
    }
}

/// What the decoder's first layer takes of the pictures of its objects.
#[derive(Clone, Debug)]
pub(crate) struct AlignedFeatures {
    /// As many features as the layer has.
    planes: PixelAligned,
    /// Weights of the point in the camera's axes.
    place: Tensor<2>,
}

impl AlignedFeatures {
    /// What is added to the layer, `[n, hidden]`, at points `[n, 3]` of objects `[n]`, or of the first object.
    pub fn at(&self, points: &Tensor<2>, object: Option<&Tensor<1, Int>>) -> Tensor<2> {
        let object = object_of(points, object);
        self.planes.at(points, &object) + self.planes.in_camera_axes(points, &object).matmul(self.place.clone())
    }

    /// The same, and its derivatives along directions `[n, 3]`.
    pub fn tangents(
        &self,
        points: &Tensor<2>,
        object: Option<&Tensor<1, Int>>,
        directions: &[Tensor<2>],
    ) -> (Tensor<2>, Vec<Tensor<2>>) {
        let object = object_of(points, object);
        let turned = |vectors: &Tensor<2>| self.planes.in_camera_axes(vectors, &object).matmul(self.place.clone());
        let (features, along) = self.planes.tangents(points, &object, directions);
        let along = along.into_iter().zip(directions).map(|(along, direction)| along + turned(direction));
        (features + turned(points), along.collect())
    }

    /// The same off the graph.
    pub fn inner(&self) -> Self {
        Self { planes: self.planes.inner(), place: self.place.clone().inner() }
    }
}

fn object_of(points: &Tensor<2>, object: Option<&Tensor<1, Int>>) -> Tensor<1, Int> {
    object.cloned().unwrap_or_else(|| Tensor::zeros([points.dims()[0]], &points.device()))
}

#[cfg(test)]
mod tests {
    use burn::tensor::Distribution;
    use dvr_render::{Crossing, Differentiable, Field, Query};
    use glam::DVec3;

    use super::*;

    fn local() -> (ImageModel, Tensor<4>, Vec<Camera>) {
        let device = Device::flex();
        let encoder = EncoderConfig::Local { image_size: 64, width: 2, channels: 4 };
        let decoder = DecoderConfig::new().with_code_dim(6).with_hidden(16);
        let mut model = ImageModelConfig { encoder, decoder }.init(&device);
        if let Some(layer) = &mut model.aligned {
            layer.features.weight =
                layer.features.weight.clone().map(|weight| weight.random_like(Distribution::Normal(0.0, 0.3)));
        }
        let images = Tensor::random([2, 3, 64, 64], Distribution::Uniform(0.0, 1.0), &device);
        let cameras = [DVec3::new(0.3, 0.4, -2.0), DVec3::new(-1.5, 0.2, 1.0)]
            .map(|eye| Camera::look_at(64, 64, 60.0, eye, DVec3::ZERO, DVec3::Y));
        (model, images, cameras.to_vec())
    }

    fn query(device: &Device) -> Query {
        let points = Tensor::from_floats([[0.1, 0.2, -0.1], [-0.2, 0.05, 0.3], [0.3, -0.3, 0.2]], device);
        Query { object: Some(Tensor::from_ints([0, 1, 0], device)), ..Query::new(points) }
    }

    fn logits(field: &Conditioned) -> Vec<f32> {
        field.occupancy_logit(&query(&field.device())).into_data().iter::<f32>().collect()
    }

    #[test]
    fn a_field_depends_on_the_picture_where_its_points_lie_in_it() {
        let (model, images, cameras) = local();
        let rows = || Tensor::from_ints([0, 0], &Device::flex());
        let seen = model.see(images.clone(), rows(), Some(&cameras));
        assert!(seen.camera_error.is_some_and(|error| error.into_scalar::<f32>() > 0.0));
        let from_elsewhere = model.see(images.clone(), rows(), Some(&[cameras[1].clone(), cameras[0].clone()])).field;
        let with_codes_alone = model.field(model.codes(images.clone(), rows()));
        let guessed = model.see(images, rows(), None);
        assert!(guessed.camera_error.is_none(), "nothing is known of it");
        for other in [from_elsewhere, with_codes_alone, guessed.field] {
            assert!(logits(&seen.field) != logits(&other));
        }
        assert!(seen.field.snapshots().is_empty(), "the fused tiles do not know the picture");
    }

    #[test]
    fn slopes_of_pixel_aligned_fields_are_those_of_differences() {
        let (model, images, cameras) = local();
        let device = Device::flex();
        let field = model.see(images, Tensor::from_ints([0, 0], &device), Some(&cameras)).field;
        let query = query(&device);
        let gradient: Vec<f32> = field.occupancy_gradient(&query).into_data().iter::<f32>().collect();
        let step = 1e-3;
        for axis in 0..3 {
            let mut direction = [0.0f32; 3];
            direction[axis] = 1.0;
            let direction = Tensor::<2>::from_floats([direction], &device);
            let at = |shift: f64| {
                let points = query.points.clone() + direction.clone() * shift;
                let moved = Query { points, ..query.clone() };
                field.occupancy_logit(&moved).into_data().iter::<f32>().collect::<Vec<_>>()
            };
            let (after, here, before) = (at(step), at(0.0), at(-step));
            for point in 0..3 {
                let slope = |a: f32, b: f32, step: f64| (a - b) / step as f32;
                // A ReLU may change sides between two of the points, hardly between all.
                let slopes = [
                    slope(after[point], before[point], 2.0 * step),
                    slope(after[point], here[point], step),
                    slope(here[point], before[point], step),
                ];
                let found = gradient[3 * point + axis];
                let is_near = |slope: &f32| (found - slope).abs() < 0.02 * slope.abs().max(0.3);
                assert!(slopes.iter().any(is_near), "{found} {slopes:?}");
            }
        }
    }
}
