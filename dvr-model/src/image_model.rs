//! The model of many objects: an encoder that makes codes and the decoder that they condition.

use burn::module::Module;
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::{Device, Int, Tensor};
use dvr_core::Camera;
use dvr_core::number_range::{NumberRange, OutOfRange, check_config, nested};
use serde::{Deserialize, Serialize};

use crate::aligned_features::AlignedFeatures;
use crate::conditioned::Conditioned;
use crate::decoder::{Decoder, DecoderConfig};
use crate::encoder::{Encoder, EncoderConfig};

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
        let aligned = self
            .encoder
            .local_channels()
            .map_or(0, |channels| (channels as u64).saturating_add(3).saturating_mul(self.decoder.hidden as u64));
        let encoder = self.encoder.parameters(self.decoder.code_dim);
        self.decoder.parameters().saturating_add(encoder).saturating_add(aligned)
    }

    /// A model with fresh parameters.
    pub fn init(&self, device: &Device) -> ImageModel {
        let encoder = self.encoder.init(self.decoder.code_dim, device);
        let aligned =
            self.encoder.local_channels().map(|channels| AlignedLayer::new(channels, self.decoder.hidden, device));
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
        let aligned =
            AlignedFeatures { planes: aligned, features: layer.features.weight.val(), place: layer.place.weight.val() };
        Seen { field: self.field(codes).with_aligned(Some(aligned)), camera_error }
    }
}

#[cfg(test)]
mod tests {
    use burn::module::{ModuleVisitor, Param};
    use burn::tensor::{Distribution, Gradients};
    use dvr_render::{Crossing, Differentiable, Field, Query};
    use dvr_test_support::{largest, max_difference};
    use glam::{DVec3, Vec3};

    use super::*;

    const KINDS: [EncoderConfig; 2] = [
        EncoderConfig::Local { image_size: 64, width: 2, channels: 4 },
        EncoderConfig::LocalBn { image_size: 64, width: 2, channels: 4 },
    ];

    fn local(encoder: EncoderConfig) -> (ImageModel, Tensor<4>, Vec<Camera>) {
        local_on(encoder, &Device::flex())
    }

    fn local_on(encoder: EncoderConfig, device: &Device) -> (ImageModel, Tensor<4>, Vec<Camera>) {
        let decoder = DecoderConfig::new().with_code_dim(6).with_hidden(16);
        let mut model = ImageModelConfig { encoder, decoder }.init(device);
        if let Some(layer) = &mut model.aligned {
            layer.features.weight =
                layer.features.weight.clone().map(|weight| weight.random_like(Distribution::Normal(0.0, 0.3)));
        }
        let images = Tensor::random([2, 3, 64, 64], Distribution::Uniform(0.0, 1.0), device);
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
        KINDS.into_iter().for_each(depends_on_the_picture);
    }

    fn depends_on_the_picture(encoder: EncoderConfig) {
        let (model, images, cameras) = local(encoder);
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
    }

    /// Gradients by all parameters that have one.
    struct Collected<'a> {
        gradients: &'a Gradients,
        all: Vec<Vec<f32>>,
    }

    impl ModuleVisitor for Collected<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = param.val().grad(self.gradients);
            self.all.extend(gradient.map(|gradient| gradient.into_data().iter::<f32>().collect::<Vec<_>>()));
        }
    }

    #[test]
    fn at_constant_points_gradients_are_those_of_burns_operations() {
        let device = Device::flex().autodiff();
        for encoder in KINDS {
            let (model, images, cameras) = local_on(encoder, &device);
            let query = query(&device);
            let found = |logits: fn(&Conditioned, &Query) -> Tensor<1>| {
                let field = model.see(images.clone(), Tensor::from_ints([0, 0], &device), Some(&cameras)).field;
                let gradients = logits(&field, &query).square().sum().backward();
                let mut collected = Collected { gradients: &gradients, all: Vec::new() };
                model.visit(&mut collected);
                collected.all
            };
            let expected = found(|field, query| field.occupancy_logit(query));
            let by_hand = found(|field, query| field.occupancy_logit_of_points(query));
            assert_eq!(by_hand.len(), expected.len());
            for (i, (by_hand, expected)) in by_hand.iter().zip(&expected).enumerate() {
                let size = largest(expected.iter().map(|value| value.abs()));
                assert!(max_difference(by_hand, expected) <= 1e-4 * size, "{i}: {size}");
            }
        }
    }

    #[test]
    fn off_the_tensors_and_at_constant_points_a_field_is_the_same() {
        for encoder in KINDS {
            let (model, images, cameras) = local(encoder);
            let device = Device::flex();
            let field = model.see(images, Tensor::from_ints([0, 0], &device), Some(&cameras)).field;
            let query = query(&device);
            let numbers = |tensor: Tensor<1>| tensor.into_data().iter::<f32>().collect::<Vec<_>>();
            let expected = numbers(field.occupancy_logit(&query));
            assert!(max_difference(&numbers(field.occupancy_logit_of_points(&query)), &expected) < 1e-5);
            let gradients: Vec<f32> = field.occupancy_gradient(&query).into_data().iter::<f32>().collect();
            let at: Vec<f32> = query.points.into_data().iter::<f32>().collect();
            let snapshots = field.snapshots();
            assert_eq!(snapshots.len(), 2);
            for (point, object) in [0, 1, 0].into_iter().enumerate() {
                let at = [Vec3::from_slice(&at[3 * point..])];
                assert!(max_difference(&snapshots[object].logits(&at), &expected[point..=point]) < 1e-5);
                let gradient = snapshots[object].gradients(&at).unwrap()[0].to_array();
                let apart = max_difference(&gradient, &gradients[3 * point..][..3]);
                assert!(apart < 1e-4 * largest(gradient.map(f32::abs)).max(1.0), "{apart}");
            }
        }
    }

    #[test]
    fn slopes_of_pixel_aligned_fields_are_those_of_differences() {
        let [_, encoder] = KINDS;
        let (model, images, cameras) = local(encoder);
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
