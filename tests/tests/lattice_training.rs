//! The lattice decoder learns from pictures through the public API.

use burn::tensor::Device;
use dvr_core::mesh::shapes;
use dvr_model::LatticeDecoderConfig;
use dvr_tests::rendered_scene;
use dvr_train::{StepReport, Supervision, TrainConfig, Trainer, ViewSplit};

const STEPS: usize = 120;

#[test]
fn a_lattice_that_starts_as_a_large_grey_ball_learns_a_small_one() {
    let scene = rendered_scene(shapes::icosphere(2, 1.0), 10, 24);
    let device = Device::flex();
    let config = TrainConfig { rays: 256, steps: STEPS, learning_rate: 0.1, ..TrainConfig::new(Supervision::Rgb) };
    let views = ViewSplit::new(&scene, config.hold_out_every).unwrap();
    let field = LatticeDecoderConfig::new().with_cells(16).with_color_cells(8).with_radius(0.55);
    let mut trainer = Trainer::new(field.init(&device.clone().autodiff()), views, config, device);
    let reports: Vec<StepReport> = (0..STEPS).map(|_| trainer.step().unwrap()).collect();
    let mean = |of: &dyn Fn(&StepReport) -> f64| {
        [&reports[..10], &reports[STEPS - 10..]].map(|part| part.iter().map(of).sum::<f64>() / 10.0)
    };
    let (loss, silhouettes) = (mean(&|report| report.loss), mean(&|report| report.mask_iou));
    println!("loss {loss:.3?}, silhouette IoU {silhouettes:.3?}");
    assert!(loss[1] < 0.5 * loss[0]);
    assert!(silhouettes[1] > 0.88 && silhouettes[1] > silhouettes[0] + 0.05);
}
