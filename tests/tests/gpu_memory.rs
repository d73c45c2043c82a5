//! A limit on GPU memory holds: what tensors hold is measured, and a run that holds more is saved and ends.

use burn::tensor::Tensor;
use dvr_core::mesh::shapes;
use dvr_tests::{gpu, rendered_scene, test_with};
use dvr_train::{Checkpoint, Error, FieldMethod, RunFolder, RunOptions, Supervision, TrainConfig, train};

// One test, because the limit holds for the whole process.
#[test_with(gpu)]
fn a_run_that_holds_more_memory_than_it_may_is_saved_and_ends() {
    let gpu = gpu();
    let before = dvr_gpu::memory_held(&gpu).expect("the GPU reports it");
    let tensor = Tensor::<1>::zeros([1 << 20], &gpu);
    gpu.sync().unwrap();
    let held = dvr_gpu::memory_held(&gpu).expect("the GPU reports it");
    assert!(held >= before + (4 << 20), "four bytes a number: {before}, then {held}");
    assert_eq!(dvr_gpu::memory_excess(&gpu), None, "no limit yet");
    let points = dvr_gpu::points_at_once(&gpu).expect("a GPU");
    dvr_gpu::limit_memory(held / 2);
    let excess = dvr_gpu::memory_excess(&gpu).expect("more than half of itself");
    assert_eq!((excess.held, excess.allowed), (held, held / 2));
    assert!(dvr_gpu::points_at_once(&gpu) < Some(points), "work is cut smaller");
    drop(tensor);

    let folder = tempfile::tempdir().unwrap();
    let mut scene = rendered_scene(shapes::icosphere(2, 1.0), 8, 16);
    let mut config = TrainConfig { rays: 32, steps: 40, hold_out_every: 0, ..TrainConfig::new(Supervision::Rgb) };
    (config.model.hidden, config.model.blocks, config.model.octaves) = (16, 1, 0);
    (config.hull.warm_start_steps, config.losses.normal) = (0, 0.0);
    let run = RunFolder::new(folder.path().join("run"));
    let _writing = run.create().unwrap();
    let options = RunOptions::new(run.clone(), gpu);
    dvr_gpu::limit_memory(10_000);
    let method = FieldMethod::new("small", config, |config, device| config.model.init(device)).with_decoder_settings();
    let problem = match train(&mut scene, &method, None, &options, &mut ()) {
        Err(problem @ Error::HeldMemory { .. }) => problem.to_string(),
        other => panic!("{:?}", other.map(|trained| trained.outcome.steps)),
    };
    for part in ["after step 10", "are allowed"] {
        assert!(problem.contains(part), "{part:?} is missing in: {problem}");
    }
    assert_eq!(Checkpoint::load(&run.last()).unwrap().header.step, 10);
}
