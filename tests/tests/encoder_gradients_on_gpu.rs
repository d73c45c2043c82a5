//! Gradients of image encoders on a GPU: as near to those in double precision as the CPU's in single
//! precision are.
//!
//! How far two correct implementations may be apart depends on the batch. Where the last layers see one pixel an image
//! (images of 32 pixels), batch normalisation of two images turns any two numbers into about -1 and 1: what remains of
//! a gradient behind it is a difference of nearly equal numbers, and rounding decides, on the CPU as on any other
//! device. So the yardstick is not the CPU but double precision.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::nn::conv::Conv2dConfig;
use burn::nn::pool::MaxPool2dConfig;
use burn::nn::{BatchNormConfig, PaddingConfig2d};
use burn::optim::GradientsParams;
use burn::tensor::{DType, Device, Tensor, TensorData};
use dvr_model::Resnet18;
use dvr_tests::{gpu, numbers, relative_difference, seeded, test_with};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The CPU in double precision, the CPU in single precision, and the GPU.
fn places() -> [(Device, DType); 3] {
    [(Device::flex(), DType::F64), (Device::flex(), DType::F32), (gpu(), DType::F32)]
}

/// Numbers between -1 and 1 that single precision holds exactly.
fn random(count: usize, seed: u64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| f64::from(rng.random_range(-1.0f32..1.0))).collect()
}

fn tensor4(values: &[f64], dims: [usize; 4], (device, dtype): (&Device, DType)) -> Tensor<4> {
    Tensor::from_data(TensorData::new(values.to_vec(), dims), (device, dtype))
}

/// All parameters of a module, or all their gradients, in order.
struct Collect<'a> {
    gradients: Option<&'a GradientsParams>,
    all: Vec<Vec<f64>>,
}

impl ModuleVisitor for Collect<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        match self.gradients {
            None => self.all.push(numbers(param.val())),
            // What normalisations keep running has none.
            Some(gradients) => self.all.extend(gradients.get::<D>(param.id).map(numbers)),
        }
    }
}

/// Gives a module the parameters that another has, on its own device, in a precision.
struct Fill<'a> {
    device: &'a Device,
    dtype: DType,
    values: std::slice::Iter<'a, Vec<f64>>,
}

impl ModuleMapper for Fill<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (dims, tracked) = (param.dims().to_vec(), param.is_require_grad());
        let values = self.values.next().expect("as many parameters").clone();
        let values = Tensor::<D>::from_data(TensorData::new(values, dims), (self.device, self.dtype));
        Param::initialized(param.id, values.set_require_grad(tracked))
    }
}

/// A module's outputs, and the gradients of a random functional of them by the input and by the parameters, at each
/// place.
fn answers<M: Module>(
    places: &[(Device, DType); 3],
    dims: [usize; 4],
    init: impl Fn(&Device) -> M,
    forward: impl Fn(&M, Tensor<4>) -> Tensor<4>,
) -> [[Vec<f64>; 3]; 3] {
    let mut parameters = Collect { gradients: None, all: Vec::new() };
    seeded(3, || init(&Device::flex())).visit(&mut parameters);
    places.clone().map(|(device, dtype)| {
        let device = device.autodiff();
        let module = init(&device).map(&mut Fill { device: &device, dtype, values: parameters.all.iter() });
        // With many zeros, as behind a ReLU: a maximum meets ties.
        let input: Vec<f64> = random(dims.iter().product(), 1).into_iter().map(|x| x.max(0.0)).collect();
        let input = tensor4(&input, dims, (&device, dtype)).detach().require_grad();
        let output = forward(&module, input.clone());
        let out_dims = output.dims();
        let weights = tensor4(&random(out_dims.iter().product(), 2), out_dims, (&device, dtype));
        let mut gradients = (output.clone() * weights).sum().backward();
        let by_input = numbers(input.grad_remove(&mut gradients).expect("the input is reached"));
        let gradients = GradientsParams::from_grads(gradients, &module);
        let mut by_parameters = Collect { gradients: Some(&gradients), all: Vec::new() };
        module.visit(&mut by_parameters);
        [numbers(output), by_input, by_parameters.all.concat()]
    })
}

/// How far the CPU and the GPU are from double precision: outputs, gradients by input and by parameters.
fn errors(answers: &[[Vec<f64>; 3]; 3]) -> [[f64; 3]; 2] {
    let [truth, cpu, gpu] = answers;
    let of = |found: &[Vec<f64>; 3]| {
        [0, 1, 2].map(|i| if truth[i].is_empty() { 0.0 } else { relative_difference(&found[i], &truth[i]) })
    };
    [of(cpu), of(gpu)]
}

#[test_with(gpu)]
fn every_layer_of_a_resnet_has_the_gradients_of_double_precision() {
    let places = places();
    let check = |what: &str, answers: [[Vec<f64>; 3]; 3]| {
        let [cpu, gpu] = errors(&answers);
        println!("{what}: CPU {cpu:?}, GPU {gpu:?}");
        assert!(gpu.iter().chain(&cpu).all(|error| *error < 3e-6), "{what}: {gpu:?}, the CPU {cpu:?}");
    };
    // Channels, kernel, stride, and the side of the images: all kinds of convolution that a ResNet-18 has.
    for (input, output, kernel, stride, size) in
        [(3, 64, 7, 2, 16), (64, 64, 3, 1, 4), (64, 128, 3, 2, 4), (64, 128, 1, 2, 4), (256, 256, 3, 1, 1)]
    {
        let pad = kernel / 2;
        let config = Conv2dConfig::new([input, output], [kernel, kernel])
            .with_stride([stride, stride])
            .with_padding(PaddingConfig2d::Explicit(pad, pad, pad, pad))
            .with_bias(false);
        let answers =
            answers(&places, [2, input, size, size], |device| config.init(device), |layer, x| layer.forward(x));
        check(&format!("convolution {kernel}x{kernel} of {input} channels, stride {stride}"), answers);
    }
    // The second sees two numbers a channel.
    for size in [4, 1] {
        let config = BatchNormConfig::new(16);
        let answers = answers(&places, [2, 16, size, size], |device| config.init(device), |norm, x| norm.forward(x));
        check(&format!("normalisation of 2 images of {size} pixels a side"), answers);
    }
    let pool =
        MaxPool2dConfig::new([3, 3]).with_strides([2, 2]).with_padding(PaddingConfig2d::Explicit(1, 1, 1, 1)).init();
    check("maximum", answers(&places, [2, 8, 8, 8], |_| pool.clone(), |pool, x| pool.forward(x)));
}

#[test_with(gpu)]
fn a_resnets_gradients_are_those_of_double_precision_but_for_two_small_images_where_rounding_makes_them() {
    let places = places();
    let errors_of = |batch: usize| {
        let code = |encoder: &Resnet18, images| encoder.forward(images).unsqueeze_dims(&[2, 3]);
        let errors = errors(&answers(&places, [batch, 3, 32, 32], |device| Resnet18::new(8, device), code));
        println!("{batch} images: CPU {:?}, GPU {:?}", errors[0], errors[1]);
        errors
    };
    let [cpu, gpu] = errors_of(8);
    // 8e-6 to 1.2e-5 on the CPU and on llvmpipe.
    assert!(cpu.iter().chain(&gpu).all(|error| *error < 2e-5), "8 images: {gpu:?}, the CPU {cpu:?}");
    // Of two images, the CPU's own gradients are as far from the truth as they are long.
    let [cpu, gpu] = errors_of(2);
    assert!(cpu[2] > 1e-3 && gpu[2] < 10.0 * cpu[2], "2 images: {gpu:?}, the CPU {cpu:?}");
}
