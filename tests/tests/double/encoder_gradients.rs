//! The gradient of depth reaches the encoder's first layer: end to end, against differences of the whole march.

use burn::module::Param;
use burn::nn::Linear;
use burn::tensor::{Device, Int, Tensor, TensorData};
use dvr_core::{Camera, Ray, UnitCube};
use dvr_model::{
    AlignedLayer, Conditioned, Convolutions, DecoderConfig, Encoder, EncoderConfig, ImageModel, ImageModelConfig,
};
use dvr_render::{Hits, MarchSettings, Marcher, Rays, SlopeRule, Surface, TensorMarcher};
use dvr_tests::*;
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// No damping: what the implicit function theorem says.
const EXACT: SlopeRule = SlopeRule::ScaleFree { epsilon: 0.0 };

/// Objects in the batch, and rays of each.
const OBJECTS: usize = 2;
const RAYS: usize = 12;

/// Two images with their cameras, and rays that look at the objects which the model sees in them.
struct Setup {
    model: ImageModel,
    images: Tensor<4>,
    cameras: Vec<Camera>,
    rays: Rays,
    weights: Vec<f64>,
}

impl Setup {
    /// An encoder whose codes lie near one that the fixtures' decoder was trained with, nearer the smaller its
    /// `influence`.
    fn new(config: &EncoderConfig, size: usize, influence: f64, device: &Device) -> Self {
        device.seed(5);
        let tracking = device.clone().autodiff();
        let (_, decoder) = fixture_decoder(32, device);
        let codes = Fixture::open("codes_c32").numbers("codes");
        let near = |last: Linear| Linear {
            weight: last.weight.map(|weight| (weight * influence).detach().require_grad()),
            bias: Some(Param::from_tensor(tensor1(&codes[..32], &tracking))),
        };
        let hidden = decoder.fc_p.weight.dims()[1];
        let like = DecoderConfig::new().with_code_dim(32).with_hidden(hidden);
        let ImageModel { encoder, aligned, .. } =
            ImageModelConfig { encoder: config.clone(), decoder: like }.init(&tracking);
        let encoder = match encoder {
            Encoder::Resnet18(mut encoder) => {
                encoder.fc = near(encoder.fc);
                Encoder::Resnet18(encoder)
            }
            Encoder::Convolutional(mut encoder) => {
                encoder.fc_out = near(encoder.fc_out);
                Encoder::Convolutional(encoder)
            }
            Encoder::ConvolutionalBn(mut encoder) => {
                encoder.fc = near(encoder.fc);
                Encoder::ConvolutionalBn(encoder)
            }
            Encoder::Local(mut encoder) => {
                encoder.convolutional = match encoder.convolutional {
                    Convolutions::Plain(mut layers) => {
                        layers.fc_out = near(layers.fc_out);
                        Convolutions::Plain(layers)
                    }
                    Convolutions::Normalised(mut layers) => {
                        layers.fc = near(layers.fc);
                        Convolutions::Normalised(layers)
                    }
                };
                Encoder::Local(encoder)
            }
            Encoder::Codes(codes) => Encoder::Codes(codes),
        };
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut random = |n: usize, low: f64| (0..n).map(|_| rng.random_range(low..1.0)).collect::<Vec<f64>>();
        let images = tensor1(&random(OBJECTS * 3 * size * size, 0.0), &tracking).reshape([OBJECTS, 3, size, size]);
        let rays: Vec<Ray> = (0..OBJECTS * RAYS)
            .map(|_| {
                let (eye, target) = (DVec3::from_slice(&random(3, -1.0)), DVec3::from_slice(&random(3, -1.0)));
                let origin = 1.5 * eye.normalize();
                Ray { origin, direction: 0.08 * target - origin }
            })
            .collect();
        let weights = random(rays.len(), -1.0);
        // As fresh, it takes nothing of the picture.
        let aligned = aligned.map(|layer: AlignedLayer| {
            let [channels, hidden] = layer.features.weight.dims();
            let small: Vec<f64> = random(channels * hidden, -1.0).into_iter().map(|number| 0.02 * number).collect();
            let weight = Param::from_tensor(tensor1(&small, &tracking).reshape([channels, hidden]));
            let place =
                Linear { weight: layer.place.weight.map(|weight| (weight * 0.1).detach().require_grad()), bias: None };
            AlignedLayer { features: Linear { weight, bias: None }, place }
        });
        let cameras = [DVec3::new(0.5, 0.4, -1.6), DVec3::new(-1.2, 0.3, 0.9)]
            .map(|eye| Camera::look_at(size as u32, size as u32, size as f64, eye, DVec3::ZERO, DVec3::Y))
            .to_vec();
        let mut rays = Rays::new(&rays, UnitCube::default(), device);
        let object = (0..OBJECTS * RAYS).map(|i| (i / RAYS) as i64).collect();
        rays.object = Some(Tensor::from_data(TensorData::new(object, [OBJECTS * RAYS]), device));
        Self { model: ImageModel { encoder, decoder, aligned }, images, cameras, rays, weights }
    }

    /// The field that the model with this encoder sees, on the graph; normalisations take the statistics of the batch.
    fn field(&self, encoder: &Encoder) -> Conditioned {
        let objects = Tensor::<1, Int>::arange(0..OBJECTS as i64, &self.images.device());
        let model = ImageModel { encoder: encoder.clone(), ..self.model.clone() };
        model.see(self.images.clone(), objects, Some(&self.cameras)).field
    }

    fn march(&self, frozen: Conditioned) -> Hits {
        let settings = MarchSettings { steps: 128, root_steps: 60, ..MarchSettings::default() };
        TensorMarcher::new(frozen, settings).march(&self.rays, None).hits.expect("rays hit")
    }

    /// `sum weight * depth` over the rays that hit, by marching alone, and how many those are.
    fn value(&self, encoder: &Encoder) -> (f64, usize) {
        let hits = self.march(self.field(encoder).without_gradients());
        let index = hits.index.into_data();
        let weighted = index.iter::<i64>().zip(numbers(hits.depth)).map(|(i, depth)| self.weights[i as usize] * depth);
        (weighted.sum(), index.iter::<i64>().count())
    }
}

/// The weights of the first convolution.
fn first_layer(encoder: &Encoder) -> Param<Tensor<4>> {
    match encoder {
        Encoder::Resnet18(encoder) => encoder.features.conv1.weight.clone(),
        Encoder::Convolutional(encoder) => encoder.conv0.weight.clone(),
        Encoder::ConvolutionalBn(encoder) => encoder.layers[0].conv.weight.clone(),
        Encoder::Local(encoder) => match &encoder.convolutional {
            Convolutions::Plain(layers) => layers.conv0.weight.clone(),
            Convolutions::Normalised(layers) => layers.layers[0].conv.weight.clone(),
        },
        Encoder::Codes(_) => unreachable!("has no layers"),
    }
}

/// The encoder with its first convolution moved along a direction.
fn moved(encoder: &Encoder, direction: &Tensor<4>, step: f64) -> Encoder {
    let add = |param: Param<Tensor<4>>| param.map(|weight| weight.detach() + direction.clone() * step);
    match encoder.clone() {
        Encoder::Resnet18(mut encoder) => {
            encoder.features.conv1.weight = add(encoder.features.conv1.weight);
            Encoder::Resnet18(encoder)
        }
        Encoder::Convolutional(mut encoder) => {
            encoder.conv0.weight = add(encoder.conv0.weight);
            Encoder::Convolutional(encoder)
        }
        Encoder::ConvolutionalBn(mut encoder) => {
            encoder.layers[0].conv.weight = add(encoder.layers[0].conv.weight.clone());
            Encoder::ConvolutionalBn(encoder)
        }
        Encoder::Local(mut encoder) => {
            match &mut encoder.convolutional {
                Convolutions::Plain(layers) => layers.conv0.weight = add(layers.conv0.weight.clone()),
                Convolutions::Normalised(layers) => {
                    layers.layers[0].conv.weight = add(layers.layers[0].conv.weight.clone());
                }
            }
            Encoder::Local(encoder)
        }
        Encoder::Codes(codes) => Encoder::Codes(codes),
    }
}

#[test]
fn the_gradient_of_depth_for_the_first_convolution_equals_differences_of_encoder_and_march() {
    let device = double_precision_device();
    // Image size, weight of the last layer, and the step of the differences: so small that no ReLU changes sides, of
    // which a ResNet has many.
    let kinds = [
        (EncoderConfig::Convolutional { image_size: 63, width: 2 }, 63, 2.0, 1e-7),
        (EncoderConfig::Local { image_size: 63, width: 2, channels: 3 }, 63, 2.0, 1e-7),
        (EncoderConfig::LocalBn { image_size: 64, width: 2, channels: 3 }, 64, 0.5, 3e-9),
        (EncoderConfig::Resnet18 { image_size: 64 }, 64, 0.05, 3e-9),
    ];
    for (config, size, influence, difference) in kinds {
        let setup = Setup::new(&config, size, influence, &device);
        let weight = first_layer(&setup.model.encoder);
        let field = setup.field(&setup.model.encoder);
        let frozen = field.without_gradients();
        let hits = setup.march(frozen.clone());
        assert!(hits.len() > RAYS, "enough rays hit: {}", hits.len());

        let depth = Surface::on_graph(&field, &frozen, &hits, EXACT).depth;
        let weights: Vec<f64> = hits.index.into_data().iter::<i64>().map(|i| setup.weights[i as usize]).collect();
        let gradients = (depth * tensor1(&weights, &device.clone().autodiff())).sum().backward();
        let gradient = weight.val().grad(&gradients).expect("it reaches the first layer");

        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let direction: Vec<f64> =
            (0..weight.val().shape().num_elements()).map(|_| rng.random_range(-1.0..1.0)).collect();
        let analytic: f64 = numbers(gradient).iter().zip(&direction).map(|(g, d)| g * d).sum();
        let direction = tensor1(&direction, &device.clone().autodiff()).reshape(weight.val().dims());
        let [(above, hits_above), (below, hits_below)] =
            [difference, -difference].map(|step| setup.value(&moved(&setup.model.encoder, &direction, step)));
        assert_eq!((hits_above, hits_below), (weights.len(), weights.len()), "the same rays hit");
        let numeric = (above - below) / (2.0 * difference);
        let error = (analytic - numeric).abs() / numeric.abs();
        assert!(error < 1e-6, "{config:?}: analytic {analytic}, differences {numeric}, relative error {error:e}");
    }
}
