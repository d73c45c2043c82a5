use burn::module::Module;
use burn::tensor::{Device, Distribution, Tensor};
use dvr_core::Camera;
use glam::DVec3;
use safetensors::SafeTensors;

use super::*;
use crate::{EncoderConfig, from_safetensors, to_safetensors};

/// What makes shapes of codes.
const KINDS: [ShapeDecoderConfig; 4] = [
    ShapeDecoderConfig::Voxels { width: 4 },
    ShapeDecoderConfig::Points { width: 4 },
    ShapeDecoderConfig::Patches { patches: 3, width: 16 },
    ShapeDecoderConfig::Sphere { width: 16 },
];

/// What a decoder makes of codes, an object a row.
fn outputs(decoder: &ShapeDecoder, codes: Tensor<2>) -> Tensor<2> {
    match decoder {
        ShapeDecoder::Voxels(decoder) => decoder.forward(codes).flatten(1, 3),
        ShapeDecoder::Points(decoder) => decoder.forward(codes).flatten(1, 2),
        ShapeDecoder::Patches(decoder) => {
            let places = Tensor::random([decoder.patches(), 7, 2], Distribution::Default, &codes.device());
            decoder.forward(codes, places).flatten(1, 2)
        }
        ShapeDecoder::Sphere(decoder) => decoder.forward(codes).flatten(1, 2),
        ShapeDecoder::Graph(_) => unreachable!("has no codes"),
    }
}

#[test]
fn every_decoder_makes_a_shape_of_each_code_and_all_of_its_parameters_learn() {
    let device = Device::flex().autodiff();
    for (kind, numbers) in KINDS.into_iter().zip([32 * 32 * 32, 3 * PointDecoder::POINTS, 3 * 3 * 7, 3 * 642]) {
        let decoder = kind.init(5, 0, &device);
        let codes = Tensor::<2>::random([2, 5], Distribution::Normal(0.0, 1.0), &device);
        let made = outputs(&decoder, codes);
        assert_eq!(made.dims(), [2, numbers], "{kind:?}");
        let gradients = burn::optim::GradientsParams::from_grads((made.clone() * made).sum().backward(), &decoder);
        let learning = gradients.len();
        // A weight and a bias for each layer, but for the first of the patches, which has two weights, and the normalisation of
        // voxels.
        assert_eq!(learning, [10, 16, 9, 8][KINDS.iter().position(|k| *k == kind).unwrap()], "{kind:?}");
    }
}

#[test]
fn codes_of_one_batch_do_not_touch_each_other() {
    let device = Device::flex();
    for kind in [KINDS[0], KINDS[1], KINDS[3]] {
        let decoder = kind.init(5, 0, &device);
        let codes = Tensor::<2>::random([3, 5], Distribution::Normal(0.0, 1.0), &device);
        let second = outputs(&decoder, codes.clone().narrow(0, 1, 1));
        let difference = (outputs(&decoder, codes).narrow(0, 1, 1) - second).abs().max();
        assert!(difference.into_scalar::<f32>() < 1e-5, "{kind:?}");
    }
}

#[test]
fn patches_of_one_place_are_alike_whatever_else_is_asked() {
    let device = Device::flex();
    let decoder = PatchDecoder::new(2, 16, 3, &device);
    let codes = Tensor::<2>::random([2, 3], Distribution::Default, &device);
    let places = Tensor::<3>::random([2, 4, 2], Distribution::Default, &device);
    let all = decoder.forward(codes.clone(), places.clone());
    // Place 1 of the second patch, of the second object.
    let one = decoder.forward(codes.narrow(0, 1, 1), places.narrow(1, 1, 1));
    let difference = all.narrow(0, 1, 1).narrow(1, 5, 1) - one.narrow(1, 1, 1);
    assert!(difference.abs().max().into_scalar::<f32>() < 1e-6);
}

#[test]
fn a_sphere_starts_as_the_sphere_and_stays_in_the_cube() {
    let device = Device::flex();
    let decoder = SphereDecoder::new(16, 4, &device);
    let half = dvr_core::UnitCube::default().half_extent() as f32;
    let vertices = decoder.forward(Tensor::random([1, 4], Distribution::Default, &device));
    let vertices: Vec<f32> = vertices.into_data().iter::<f32>().collect();
    for (made, vertex) in vertices.chunks(3).zip(&SphereDecoder::sphere().vertices) {
        let off = (glam::Vec3::from_slice(made) - *vertex * half).length();
        assert!(off < 0.02, "{made:?} {vertex}");
    }
    let wild = decoder.forward(Tensor::random([4, 4], Distribution::Normal(0.0, 1e5), &device));
    assert!(wild.abs().max().into_scalar::<f32>() <= half + 1e-6);
}

#[test]
fn a_graph_deforms_a_ball_by_what_the_camera_sees_and_all_of_its_parameters_learn() {
    let device = Device::flex().autodiff();
    let encoder = EncoderConfig::Local { image_size: 64, width: 2, channels: 4 };
    let config = ShapeModelConfig { encoder, code_dim: 3, decoder: ShapeDecoderConfig::Graph { width: 8 } };
    let model = config.init(&device);
    let pictures = Tensor::random([2, 3, 64, 64], Distribution::Uniform(0.0, 1.0), &device);
    let camera = |eye| Camera::look_at(64, 64, 60.0, eye, DVec3::ZERO, DVec3::Y);
    let cameras = [camera(DVec3::new(0.3, 0.4, -2.0)), camera(DVec3::new(-1.5, 0.2, 1.0))];
    let (stages, error) = model.deformed(pictures.clone(), Some(&cameras)).unwrap();
    let sizes: Vec<[usize; 3]> = stages.iter().map(|stage| stage.vertices.dims()).collect();
    assert_eq!(sizes, [[2, 42, 3], [2, 162, 3], [2, 642, 3]]);
    let finest = stages.last().unwrap().vertices.clone();
    let length: Vec<f32> = finest.clone().square().sum_dim(2).sqrt().into_data().iter::<f32>().collect();
    assert!(length.iter().all(|length| (0.15..0.3).contains(length)), "it starts near the ball");
    let weights = Tensor::random(finest.dims(), Distribution::Uniform(-1.0, 1.0), &device);
    let loss = (finest * weights).sum() + error.unwrap().sum();
    let gradients = burn::optim::GradientsParams::from_grads(loss.backward(), &model);
    // Of the convolutions' last layer and the code's, which the vertices do not depend on, the first learns from the cameras.
    let (all, of_code) = (count_parameters(&model), 2);
    assert_eq!(gradients.len(), all - of_code);
    let elsewhere = model.deformed(pictures, Some(&[cameras[1].clone(), cameras[0].clone()])).unwrap().0;
    let moved = (elsewhere[0].vertices.clone() - stages[0].vertices.clone()).abs().max().into_scalar::<f32>();
    assert!(moved > 0.0);
}

/// How many tensors a model learns.
fn count_parameters(model: &ShapeModel) -> usize {
    struct Count(usize);
    impl burn::module::ModuleVisitor for Count {
        fn visit_float<const D: usize>(&mut self, param: &burn::module::Param<Tensor<D>>) {
            self.0 += usize::from(param.val().is_require_grad());
        }
    }
    let mut count = Count(0);
    model.visit(&mut count);
    count.0
}

#[test]
fn a_model_comes_back_from_its_file_with_the_same_values() {
    let device = Device::flex();
    let graph = ShapeDecoderConfig::Graph { width: 8 };
    for decoder in KINDS.into_iter().chain([graph]) {
        let encoder = match decoder {
            ShapeDecoderConfig::Graph { .. } => EncoderConfig::Local { image_size: 64, width: 2, channels: 4 },
            _ => EncoderConfig::Codes { objects: 3 },
        };
        let config = ShapeModelConfig { encoder, code_dim: 5, decoder };
        config.check().unwrap();
        let model = config.init(&device);
        assert!(config.parameters() <= model.num_params() as u64, "{decoder:?}");
        let bytes = to_safetensors(&model, &config).unwrap();
        let (read_config, read): (ShapeModelConfig, ShapeModel) = from_safetensors(&bytes, &device).unwrap();
        assert_eq!(read_config, config);
        let again = to_safetensors(&read, &config).unwrap();
        let [first, second] = [&bytes, &again].map(|bytes| SafeTensors::deserialize(bytes).unwrap());
        assert_eq!(first.len(), second.len());
        assert!(first.iter().all(|(name, tensor)| second.tensor(name).unwrap() == tensor), "{decoder:?}");
    }
}
