//! Data parallel: a step that several devices share is the step of one.

use burn::tensor::Device;
use dvr_core::mesh::shapes;
use dvr_model::DecoderConfig;
use dvr_render::{Field, Query};
use dvr_tests::{gpu, numbers, relative_difference, rendered_scene, seeded, tensor3, test_with};
use dvr_train::{Supervision, TrainConfig, Trainer};

const STEPS: usize = 6;

#[test]
fn several_devices_train_as_one_does() {
    let helpers = [Device::flex(), Device::flex()];
    trains_as_alone(&helpers[..1]);
    trains_as_alone(&helpers);
}

#[test_with(gpu)]
fn the_cpu_and_a_gpu_train_as_the_cpu_does() {
    trains_as_alone(&[gpu()]);
}

/// Whether the CPU with these helpers learns what it learns alone.
fn trains_as_alone(helpers: &[Device]) {
    let scene = rendered_scene(shapes::icosphere(2, 1.0), 10, 24);
    let mut config = TrainConfig { rays: 252, steps: STEPS, ..TrainConfig::new(Supervision::RgbDepth) };
    config.model = DecoderConfig::new().with_hidden(32).with_blocks(2).with_octaves(2);
    // The points of this loss are drawn among a device's own hits.
    config.losses.normal = 0.0;
    let device = Device::flex();
    let learn = |helpers: &[Device]| {
        let field = seeded(0, || config.model.init(&device.clone().autodiff()));
        let trainer = Trainer::new(field, scene.views.iter().collect(), Vec::new(), config.clone(), device.clone());
        let mut trainer = trainer.data_parallel(helpers.iter().cloned());
        let reports: Vec<_> = (0..STEPS).map(|_| trainer.step().unwrap()).collect();
        let points: Vec<[f64; 3]> = (0..50).map(|i| [0.01, 0.007, -0.013].map(|x| x * f64::from(i))).collect();
        let logits = trainer.frozen().occupancy_logit(&Query::new(tensor3(&points, &device)));
        (reports, numbers(logits))
    };
    let (reports, logits) = learn(&[]);
    let (shared, shared_logits) = learn(helpers);
    let apart = relative_difference(&shared_logits, &logits);
    println!("{} devices: {apart:e} apart", helpers.len() + 1);
    // The guide's figure: 4e-7 with the CPU as two devices, 2e-7 with the CPU and llvmpipe.
    assert!(apart < 2e-6, "{apart:e}");
    for (shared, alone) in shared.iter().zip(&reports) {
        assert!((shared.loss - alone.loss).abs() < 1e-5 * alone.loss, "{} and {}", shared.loss, alone.loss);
        assert_eq!(shared.terms.len(), alone.terms.len(), "the parts' terms are added up");
    }
}

#[test]
fn a_device_without_neighbours_for_the_normals_leaves_that_term_out() {
    let scene = rendered_scene(shapes::icosphere(2, 1.0), 10, 24);
    let device = Device::flex();
    let mut config = TrainConfig { rays: 252, ..TrainConfig::new(Supervision::Rgb) };
    config.model = DecoderConfig::new().with_hidden(16).with_blocks(1).with_octaves(0);
    config.losses.normal_points = 1;
    let field = seeded(0, || config.model.init(&device.clone().autodiff()));
    let trainer = Trainer::new(field, scene.views.iter().collect(), Vec::new(), config, device.clone());
    let mut trainer = trainer.data_parallel([device.clone(), device]);
    assert!((0..3).all(|_| trainer.step().unwrap().loss.is_finite()));
}
