//! The lattice decoder learns from pictures through the public API.

use burn::tensor::Device;
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{TexturedMesh, shapes};
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_model::LatticeDecoderConfig;
use dvr_train::{StepReport, Supervision, TrainConfig, Trainer, ViewSplit};

const STEPS: usize = 120;

#[test]
fn a_lattice_that_starts_as_a_large_grey_ball_learns_a_small_one() {
    let folder = tempfile::tempdir().unwrap();
    let ball = TexturedMesh { mesh: shapes::icosphere(2, 1.0), ..TexturedMesh::default() };
    let synth = SynthConfig {
        views: 10,
        width: 24,
        height: 24,
        surface_points: 100,
        occupancy_points: 100,
        ..SynthConfig::default()
    };
    render_dataset(&ball, "ball", "balls", folder.path(), &synth, &|_, _| ()).unwrap();
    let scene = read_scene(&folder.path().join("balls/ball"), &ReadOptions::default()).unwrap();

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
