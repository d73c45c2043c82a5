//! What a device is not given.

use burn::tensor::Device;
use dvr_gpu::{FastError, LatticeLevels, LatticeLosses, LatticeStep, LatticeTrainer, Photograph, Photographs};

const LOSSES: LatticeLosses = LatticeLosses {
    color: 1.0,
    texture: 0.0,
    cross_view: 0.0,
    cross_view_limit: 0.0,
    structure: 0.0,
    structure_limit: 0.0,
    structure_stride: 1,
    depth: 0.0,
    mask: 1.0,
    sharpness: 100.0,
    roughness_knee: 0.05,
    grazing: 0.05,
};

/// Four pixels of an object; the ray of the first goes along z.
fn photographs() -> Photographs {
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let view = Photograph {
        center: [0.0, 0.0, -2.0],
        to_direction: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.5, -0.5, 1.0],
        projection: identity,
        offset: [0.0; 3],
        size: [2, 2],
    };
    Photographs { views: vec![view], pixels: vec![0x01ff_ffff; 4], z_depths: Vec::new() }
}

/// One node that may move, in the middle of 27.
fn levels(channels: usize) -> LatticeLevels {
    LatticeLevels {
        levels: vec![(3, vec![13])],
        state: vec![0.0; 1 + 3 * channels],
        base: vec![0.5; channels],
        values: vec![-0.5; 27 * channels],
    }
}

#[test]
fn what_is_no_graphics_processor_is_refused() {
    let refused = LatticeTrainer::new(&Device::flex(), &photographs(), LOSSES);
    assert!(matches!(refused, Err(FastError::NoGpu)));
}

#[test]
fn what_is_too_large_is_refused_with_its_size() {
    let device = match dvr_gpu::open(0) {
        Ok(gpu) => gpu.device,
        Err(problem) => return println!("skipped: {problem}"),
    };
    let mut trainer = LatticeTrainer::new(&device, &photographs(), LOSSES).unwrap();
    trainer.enter(0.55, levels(1), levels(3)).unwrap();
    let step = |rays| LatticeStep { first: 0, rays, rates: [&[0.01], &[0.01]], roughness: 0.0, rest: ([0.5; 3], 1e-5) };
    let refused = trainer.step(&step(1 << 40)).map_err(|e| e.to_string());
    assert!(refused.is_err_and(|problem| problem.contains("lessons would take 58720256 MiB in one piece")));
    // It is still good for what fits: the ray meets the raised node, and its colour goes from gray to the pixel's
    // white.
    trainer.draw(vec![0, 0], 0).unwrap();
    trainer.step(&step(1)).unwrap();
    let lesson = trainer.sums().unwrap().lessons;
    assert!(lesson[12] == 1.0 && lesson[4..7] == [-1.0; 3], "{lesson:?}");
    let [shape, color] = trainer.states().unwrap();
    assert_eq!((shape[0], color[0]), (1.0, 1.0), "one step");
    assert!(color[1..4].iter().all(|&parameter| (parameter - 0.01).abs() < 1e-6), "{color:?}");
}
