//! Values and gradients against burn's operations.

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{Device, TensorData};
use dvr_test_support::largest;

use super::*;
use crate::decoder::DecoderConfig;
use crate::seeded;

/// Second layers of blocks are fresh zeros, which would hide what is wrong before them.
struct NoZeros;

impl ModuleMapper for NoZeros {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        param.map(|tensor| {
            let shape = tensor.dims();
            let changed = waves(shape, 0.1, &tensor.device()).inner() + tensor.inner();
            Tensor::from_inner(changed).require_grad()
        })
    }
}

fn waves<const D: usize>(shape: [usize; D], height: f32, device: &Device) -> Tensor<D> {
    let values: Vec<f32> = (0..shape.iter().product()).map(|i: usize| height * (1.7 * i as f32).sin()).collect();
    Tensor::from_data(TensorData::new(values, shape), device)
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().iter::<f32>().collect()
}

/// Values and gradients, by points, codes and some parameters, of one way to compute them.
fn found(
    decoder: &Decoder,
    points: usize,
    outputs: impl Fn(Tensor<2>, &[Tensor<2>], Option<&Tensor<1, Int>>) -> Tensor<2>,
) -> Vec<Vec<f32>> {
    let device = decoder.fc_p.weight.val().device();
    let at = waves([points, 3], 0.5, &device).require_grad();
    let code_dim = decoder.fc_c.first().map_or(0, |fc_c| fc_c.weight.dims()[0]);
    let codes = (code_dim > 0).then(|| waves([3, code_dim], 1.0, &device).require_grad());
    let owner: Vec<i64> = (0..points as i64).map(|i| (i * i + i / 50) % 3).collect();
    let object = codes.as_ref().map(|_| Tensor::from_data(TensorData::new(owner, [points]), &device));
    let values = outputs(at.clone(), &decoder.conditions(codes.clone()), object.as_ref());
    let weights = waves([points, OUTPUTS], 1.0, &device);
    let gradients = (values.clone() * weights).sum().backward();
    let of = |tensor: Tensor<2>| numbers(tensor.grad(&gradients).expect("a gradient"));
    let of_bias = |linear: &burn::nn::Linear| {
        let bias = linear.bias.as_ref().expect("a bias");
        numbers(bias.val().grad(&gradients).expect("a gradient"))
    };
    let mut all = vec![numbers(values), of(at), of(decoder.fc_p.weight.val()), of(decoder.fc_out.weight.val())];
    all.extend([of_bias(&decoder.fc_p), of_bias(&decoder.fc_out)]);
    all.extend(codes.map(of));
    all.extend(decoder.fc_c.iter().map(|fc_c| of(fc_c.weight.val())));
    for block in &decoder.blocks {
        all.extend([of(block.fc_0.weight.val()), of(block.fc_1.weight.val())]);
        all.extend([of_bias(&block.fc_0), of_bias(&block.fc_1)]);
    }
    all
}

#[test]
fn values_and_gradients_are_those_of_burns_operations() {
    let device = Device::flex().autodiff();
    let plain = DecoderConfig::new().with_hidden(24).with_blocks(3);
    let coded = plain.clone().with_code_dim(5).with_octaves(2);
    let configs = [plain.with_leaky(true), coded.clone(), coded.clone().with_film(true), coded.with_blocks(0)];
    for config in configs {
        let decoder = seeded(&device, 3, || config.init(&device)).map(&mut NoZeros);
        // One chunk that is not full, and more chunks than parts.
        for points in [37, CHUNK * PARTS + 300] {
            let expected =
                found(&decoder, points, |at, conditions, object| decoder.outputs(at, conditions, object, None));
            let ours = found(&decoder, points, |at, conditions, object| {
                decoder_at_points(&decoder, at, conditions, object, None)
            });
            assert_eq!(ours.len(), expected.len());
            for (i, (ours, expected)) in ours.iter().zip(&expected).enumerate() {
                let size = largest(expected.iter().map(|x| x.abs()));
                let apart = largest(ours.iter().zip(expected).map(|(a, b)| (a - b).abs()));
                assert!(size > 0.0 && apart < 2e-5 * size, "{config:?}, {points} points, {i}: {apart} of {size}");
            }
        }
    }
}

#[test]
fn gradients_are_the_same_bits_whatever_the_threads() {
    let device = Device::flex().autodiff();
    let config = DecoderConfig::new().with_hidden(16).with_code_dim(4).with_film(true);
    let decoder = seeded(&device, 3, || config.init(&device)).map(&mut NoZeros);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            found(&decoder, 1500, |at, conditions, object| decoder_at_points(&decoder, at, conditions, object, None))
        })
    };
    assert!(with(1) == with(3));
}
