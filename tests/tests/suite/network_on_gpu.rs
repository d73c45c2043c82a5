//! Networks on a GPU give what they give on the CPU (flex): values, marches, gradients, training, renders.
//!
//! Runs on the first adapter; a software adapter will do.

use std::sync::OnceLock;

use burn::module::{Module, ModuleVisitor, Param};
use burn::nn::Linear;
use burn::optim::GradientsParams;
use burn::tensor::{Device, Int, Tensor};
use dvr_core::mesh::shapes;
use dvr_core::{Camera, Ray, Scene, UnitCube, View};
use dvr_model::{Conditioned, Decoder, DecoderConfig};
use dvr_render::extract::FieldSurface;
use dvr_render::{
    Crossing, Differentiable, Field, FieldShader, March, MarchSettings, Marcher, Query, RayStatus, Rays,
    RenderSettings, RootMethod, Shader, SlopeRule, Surface, TensorMarcher,
};
use dvr_tests::{
    gpu, max_difference, numbers, relative_difference, rendered_scene, seeded, tensor1, tensor3, test_with,
};
use dvr_train::{StepReport, Supervision, TrainConfig, Trainer, carve_hull, hull_bound, warm_start};
use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A ball, seen from ten sides.
fn ball() -> &'static Scene {
    static BALL: OnceLock<Scene> = OnceLock::new();
    BALL.get_or_init(|| rendered_scene(shapes::icosphere(2, 1.0), 10, 24))
}

fn config(model: DecoderConfig, seed: u64) -> TrainConfig {
    let mut config = TrainConfig { rays: 96, steps: 12, seed, model, ..TrainConfig::new(Supervision::Rgb) };
    config.hull.warm_start_steps = 60;
    config.hull.warm_start_points = 256;
    config
}

/// A network that was fitted to the ball's hull on the CPU, without codes.
fn fitted(config: &TrainConfig) -> Decoder {
    let device = Device::flex().autodiff();
    let newborn = seeded(config.seed, || config.model.init(&device));
    let train: Vec<&View> = ball().views.iter().collect();
    let hull = carve_hull(&train, 32).unwrap();
    warm_start(newborn, &hull, config, &Device::flex(), &dvr_core::Cancellation::default(), |_| ()).unwrap()
}

/// The networks of the suite: narrow with an encoding, of an odd width and leaky, and as wide as a kernel allows.
fn networks() -> Vec<(&'static str, Decoder)> {
    [
        ("width 32, 2 octaves", DecoderConfig::new().with_hidden(32).with_octaves(2)),
        ("width 40, leaky", DecoderConfig::new().with_hidden(40).with_blocks(2).with_leaky(true)),
        ("width 320", DecoderConfig::new().with_hidden(320).with_blocks(1)),
    ]
    .map(|(name, model)| (name, fitted(&config(model, 0)).valid()))
    .into()
}

fn points(n: usize) -> Vec<[f64; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..n).map(|_| [(); 3].map(|()| rng.random_range(-0.5..0.5))).collect()
}

/// Rays of a camera that sees the ball, and some that start within it.
fn rays(device: &Device) -> Rays {
    let camera = Camera::look_at(20, 20, 45.0, DVec3::new(0.8, 0.5, -1.2), DVec3::ZERO, DVec3::Y);
    let mut rays: Vec<Ray> = (0..400).map(|i| camera.pixel_ray(i % 20, i / 20)).collect();
    rays.extend(
        (0..9).map(|i| Ray { origin: DVec3::splat(0.01 * f64::from(i)), direction: DVec3::new(0.3, 1.0, 0.2) }),
    );
    rays.push(Ray { origin: DVec3::splat(3.0), direction: DVec3::X });
    Rays::new(&rays, UnitCube::default(), device)
}

#[test_with(gpu)]
fn values_and_derivatives_are_those_of_the_cpu() {
    let gpu = gpu();
    for (name, decoder) in networks() {
        let answers = |decoder: &Decoder, device: &Device| {
            let query = Query::new(tensor3(&points(200), device));
            let jet = decoder.jet(&query, tensor3(&points(200), device));
            let values = decoder.evaluate(&query);
            [
                numbers(values.occupancy_logit),
                numbers(values.color),
                numbers(jet.derivative.occupancy_logit),
                numbers(jet.derivative.color),
                numbers(decoder.occupancy_gradient(&query)),
            ]
        };
        let truth = answers(&decoder, &Device::flex());
        let ours = answers(&decoder.clone().to_device(&gpu), &gpu);
        for (i, (ours, truth)) in ours.iter().zip(&truth).enumerate() {
            let scale = truth.iter().fold(1.0f64, |scale, x| scale.max(x.abs()));
            let apart = max_difference(ours, truth) / scale;
            assert!(apart < 1e-5, "{name}, answer {i}: {apart:e}");
        }
    }
}

/// The same status for all rays but one that grazes, and the same depths.
fn assert_same_march(ours: &March, truth: &March, context: &str) {
    let hits = truth.status.iter().filter(|status| **status == RayStatus::Hits).count();
    assert!(
        hits > 20 && truth.status.contains(&RayStatus::StartsInside),
        "{context}: {hits} hits are too few to compare"
    );
    let apart = ours.status.iter().zip(&truth.status).filter(|(a, b)| a != b).count();
    assert!(ours.status.len() == truth.status.len() && apart <= 1, "{context}: {apart} rays have another status");
    let depths = |march: &March| {
        let mut depths = vec![None; march.status.len()];
        let hits = march.hits.as_ref().expect("hits");
        let places = hits.index.clone().into_data().iter::<i64>().collect::<Vec<_>>();
        places
            .into_iter()
            .zip(numbers(hits.depth.clone()))
            .for_each(|(place, depth)| depths[place as usize] = Some(depth));
        depths
    };
    let (our_depths, true_depths) = (depths(ours), depths(truth));
    for (ray, depths) in our_depths.into_iter().zip(true_depths).enumerate() {
        if let (Some(ours), Some(truth)) = depths {
            assert!((ours - truth).abs() < 2e-5, "{context}: ray {ray} at {ours}, should be {truth}");
        }
    }
    // Two samples may have the same logit, to rounding.
    let largest = numbers(ours.max_logit_depth.clone());
    let pairs = largest.iter().zip(numbers(truth.max_logit_depth.clone())).zip(&truth.status);
    let is_near = |a: f64, b: f64| (a - b).abs() <= 1e-4;
    let far = pairs.filter(|((a, b), status)| **status == RayStatus::Misses && !is_near(**a, *b)).count();
    assert!(far <= 3, "{context}: {far} rays have their largest logit elsewhere");
}

#[test_with(gpu)]
fn the_kernel_and_tensors_on_the_device_find_what_tensors_on_the_cpu_find() {
    let gpu = gpu();
    for (name, decoder) in networks() {
        let on_gpu = decoder.clone().to_device(&gpu);
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let jitter: Vec<f64> = (0..410).map(|_| rng.random()).collect();
        for (steps, root, jittered) in [
            (33, RootMethod::Chandrupatla, false),
            (24, RootMethod::Chandrupatla, true),
            (16, RootMethod::Secant, true),
            (9, RootMethod::Bisection, false),
        ] {
            let settings = MarchSettings { steps, root, root_steps: 14, ..MarchSettings::default() };
            let jitter = |device: &Device| jittered.then(|| tensor1(&jitter, device));
            let truth = TensorMarcher::new(&decoder, settings).march(&rays(&Device::flex()), jitter(&Device::flex()));
            let kernel =
                on_gpu.own_marcher(settings).expect("a kernel for this network").march(&rays(&gpu), jitter(&gpu));
            assert_same_march(&kernel, &truth, &format!("{name}, kernel, {steps} samples, {root:?}"));
            if jittered {
                let tensors = TensorMarcher::new(&on_gpu, settings).march(&rays(&gpu), jitter(&gpu));
                assert_same_march(&tensors, &truth, &format!("{name}, tensors, {steps} samples, {root:?}"));
            }
        }
    }
}

#[test_with(gpu)]
fn rays_of_many_objects_meet_their_own_object_in_the_kernel() {
    for film in [false, true] {
        rays_of_three_objects_meet_their_own(film);
    }
}

fn rays_of_three_objects_meet_their_own(film: bool) {
    let gpu = gpu();
    let flex = Device::flex();
    // Codes reach the field through projections that start at random; the rest was fitted to a ball.
    let mut decoder = fitted(&config(DecoderConfig::new().with_hidden(32), 0)).valid();
    let projections =
        seeded(4, || DecoderConfig::new().with_hidden(32).with_code_dim(4).with_film(film).init(&flex).fc_c);
    decoder.fc_c = projections.into_iter().map(|projection| Linear { bias: None, ..projection }).collect();
    let codes = |device: &Device| {
        tensor1(&[0.0, 0.1, 0.0, 0.0, 0.1, 0.0, -0.1, 0.0, 0.0, 0.0, 0.05, 0.1], device).reshape([3, 4])
    };
    let rays_of_three = |device: &Device| {
        let mut rays = rays(device);
        rays.object = Some(Tensor::<1, Int>::arange(0..rays.len() as i64, device).remainder_scalar(3));
        rays
    };
    let settings = MarchSettings { steps: 32, ..MarchSettings::default() };
    let truth = TensorMarcher::new(decoder.with_codes(codes(&flex)), settings).march(&rays_of_three(&flex), None);
    let on_gpu: Conditioned = decoder.to_device(&gpu).with_codes(codes(&gpu));
    let ours = on_gpu.own_marcher(settings).expect("a kernel").march(&rays_of_three(&gpu), None);
    assert_same_march(&ours, &truth, &format!("three objects, scaled: {film}"));
}

/// All gradients of a module, one after the other.
struct Gradients<'a> {
    of: &'a GradientsParams,
    all: Vec<f64>,
}

impl ModuleVisitor for Gradients<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let gradient = self.of.get::<D>(param.id).expect("every parameter is reached");
        self.all.extend(numbers(gradient));
    }
}

#[test_with(gpu)]
fn gradients_of_march_and_depth_are_those_of_the_cpu() {
    let gpu = gpu();
    let decoder = fitted(&config(DecoderConfig::new().with_hidden(32).with_octaves(2), 0));
    let gradients = |field: &Decoder, device: &Device| {
        let frozen = field.valid();
        let march = FieldSurface::new(&frozen).marcher(MarchSettings::default()).march(&rays(device), None);
        let hits = march.hits.expect("rays hit");
        let surface = Surface::on_graph(field, &frozen, &hits, SlopeRule::default());
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        // One weight per ray of the batch, so that a ray that hits on one device alone shifts no other.
        let weights: Vec<f64> = (0..410).map(|_| rng.random_range(-1.0..1.0)).collect();
        let weights = Tensor::from_inner(tensor1(&weights, device).select(0, hits.index.clone()));
        let loss = (surface.depth * weights.clone()).sum() + (surface.color * weights.unsqueeze_dim(1)).sum();
        let of = GradientsParams::from_grads(loss.backward(), field);
        let mut visitor = Gradients { of: &of, all: Vec::new() };
        field.visit(&mut visitor);
        visitor.all
    };
    let truth = gradients(&decoder, &Device::flex());
    let ours = gradients(&decoder.clone().fork(&gpu.clone().autodiff()), &gpu);
    let apart = relative_difference(&ours, &truth);
    println!("gradients: {apart:e} apart");
    assert!(apart < 1e-4, "{apart:e}");
}

/// Trains the same network on a device: its reports, and its logits at some points.
fn train(device: &Device, seed: u64) -> (Vec<StepReport>, Vec<f64>) {
    let config = config(DecoderConfig::new().with_hidden(32).with_octaves(2), seed);
    let field = fitted(&config).fork(&device.clone().autodiff());
    let train: Vec<&View> = ball().views.iter().collect();
    let bound = hull_bound(&carve_hull(&train, 32).unwrap());
    let steps = config.steps;
    let mut trainer = Trainer::new(field, train, Vec::new(), config, device.clone()).with_bound(bound);
    let reports = (0..steps).map(|_| trainer.step().unwrap()).collect();
    let frozen = trainer.frozen();
    let logits = frozen.occupancy_logit(&Query::new(tensor3(&points(100), device)));
    (reports, numbers(logits))
}

#[test_with(gpu)]
fn training_ends_near_the_cpu_and_repeats_bit_for_bit() {
    let gpu = gpu();
    let last = |reports: &[StepReport]| reports.last().map(|report| (report.loss, report.mask_iou)).expect("steps");
    let (reports, logits) = train(&gpu, 0);
    let (again, logits_again) = train(&gpu, 0);
    assert_eq!(logits, logits_again, "the same training on the same device gives the same bits");
    // The printed loss is a sum whose order the device may choose; no gradient depends on it.
    assert!((last(&reports).0 - last(&again).0).abs() < 1e-5 * last(&again).0);

    let seeds: Vec<_> = (0..3).map(|seed| train(&Device::flex(), seed)).collect();
    let (loss, mask_iou) = last(&reports);
    let on_cpu: Vec<_> = seeds.iter().map(|(reports, _)| last(reports)).collect();
    println!("loss and IoU {loss:.4} {mask_iou:.4}, on the CPU with three seeds {on_cpu:.4?}");
    let spread = |of: fn(&(f64, f64)) -> f64| {
        let values = on_cpu.iter().map(of);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    assert!((loss - on_cpu[0].0).abs() <= spread(|report| report.0), "loss {loss}, on the CPU {on_cpu:?}");
    assert!(
        (mask_iou - on_cpu[0].1).abs() <= spread(|report| report.1).max(0.02),
        "IoU {mask_iou}, on the CPU {on_cpu:?}"
    );
    let apart = relative_difference(&logits, &seeds[0].1);
    println!("logits after training: {apart:e} apart");
    assert!(apart < 0.02, "{apart:e}");
}

#[test_with(gpu)]
fn a_render_on_the_gpu_is_that_of_the_cpu() {
    let gpu = gpu();
    let decoder = fitted(&config(DecoderConfig::new().with_hidden(32).with_octaves(2), 0)).valid();
    let camera = Camera::look_at(16, 16, 45.0, DVec3::new(0.8, 0.5, -1.2), DVec3::ZERO, DVec3::Y);
    let rays: Vec<Ray> = (0..256).map(|i| camera.pixel_ray(i % 16, i / 16)).collect();
    let on_gpu = decoder.clone().to_device(&gpu);
    let settings = RenderSettings::default();
    let truth = FieldShader::new(&decoder, settings, None).shade(&rays);
    let ours = FieldShader::new(&on_gpu, settings, None).shade(&rays);
    let mut both = 0;
    for (ours, truth) in ours.iter().zip(&truth) {
        let (Some(ours), Some(truth)) = (ours, truth) else { continue };
        both += 1;
        assert!((ours.depth - truth.depth).abs() < 1e-4, "{ours:?} {truth:?}");
        for channel in 0..3 {
            assert!((ours.color[channel] - truth.color[channel]).abs() < 1e-3, "{ours:?} {truth:?}");
        }
    }
    let one = ours.iter().zip(&truth).filter(|(a, b)| a.is_some() != b.is_some()).count();
    assert!(both > 30 && one <= 1, "{both} rays hit on both, {one} on one alone");
}
