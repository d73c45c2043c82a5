//! What a device is not given.

use burn::tensor::Device;
use dvr_gpu::DeviceError;

use super::{GpuLevels, GpuLosses, GpuStep, GpuStepInput, Photograph, Photographs};

const LOSSES: GpuLosses = GpuLosses {
    color: 1.0,
    texture: 0.0,
    photo_consistency: 0.0,
    photo_consistency_limit: 0.0,
    patch_ncc: 0.0,
    patch_ncc_min: 0.0,
    patch_stride: 1,
    depth: 0.0,
    mask: 1.0,
    sharpness: 100.0,
    smoothness_knee: 0.05,
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
fn levels(channels: usize) -> GpuLevels {
    GpuLevels {
        levels: vec![(3, vec![13])],
        state: vec![0.0; 1 + 3 * channels],
        base: vec![0.5; channels],
        values: vec![-0.5; 27 * channels],
    }
}

#[test]
fn a_device_that_is_no_gpu_is_refused() {
    let refused = GpuStep::new(&Device::flex(), &photographs(), LOSSES);
    assert!(matches!(refused, Err(DeviceError::NoGpu)));
}

#[test]
fn what_is_too_large_is_refused_with_its_size() {
    let Some(device) = dvr_test_support::gpu(dvr_gpu::open(0)).map(|gpu| gpu.device) else { return };
    let mut trainer = GpuStep::new(&device, &photographs(), LOSSES).unwrap();
    trainer.enter(0.55, levels(1), levels(3)).unwrap();
    let step =
        |rays| GpuStepInput { first: 0, rays, rates: [&[0.01], &[0.01]], smoothness: 0.0, rest: ([0.5; 3], 1e-5) };
    let refused = trainer.step(&step(1 << 40)).map_err(|e| e.to_string());
    assert!(refused.is_err_and(|problem| problem.contains("ray_gradients would take 58720256 MiB in one piece")));
    // It is still good for what fits: the ray meets the raised node, and its colour goes from gray to the pixel's
    // white.
    trainer.draw(vec![0, 0], 0).unwrap();
    trainer.step(&step(1)).unwrap();
    let ray_gradient = trainer.sums().unwrap().ray_gradients;
    assert!(ray_gradient[12] == 1.0 && ray_gradient[4..7] == [-1.0; 3], "{ray_gradient:?}");
    let [shape, color] = trainer.states().unwrap();
    assert_eq!((shape[0], color[0]), (1.0, 1.0), "one step");
    assert!(color[1..4].iter().all(|&parameter| (parameter - 0.01).abs() < 1e-6), "{color:?}");
}
