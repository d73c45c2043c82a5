//! The GPU backend as the suite sees it, and what a device refuses.

use burn::tensor::Device;
use dvr_core::Exposure;
use dvr_gpu::DeviceError;
use dvr_test_support::test_with;

use super::fixture::Fixture;
use super::{Inspected, Make, steps};
use crate::clock::PartTimes;
use crate::error::Error;
use crate::losses::GridLosses;
use crate::multires::Grids;
use crate::step::backend::StepBackend;
use crate::step::cpu::CpuBackend;
use crate::step::gpu::GpuBackend;
use crate::step::record::RayRecord;

/// The GPU.
fn gpu() -> Device {
    dvr_test_support::gpu(dvr_gpu::open(0)).device
}

/// A backend on a device.
fn backend(device: &Device, fixture: &Fixture, grids: Grids) -> Result<GpuBackend, Error> {
    GpuBackend::new(device, &fixture.views, &fixture.config, grids)
}

/// Runs a check of the suite.
pub(super) fn on_a_gpu(check: &dyn Fn(Make)) {
    let device = gpu();
    check(&|fixture, grids| Box::new(backend(&device, fixture, grids).unwrap()));
}

impl Inspected for GpuBackend {
    fn records(&mut self, fixture: &Fixture) -> Vec<RayRecord> {
        self.step(fixture.input(&mut PartTimes::default())).unwrap();
        self.kernels().records().unwrap()
    }

    fn gradients(&self) -> [Vec<f32>; 2] {
        self.kernels().gradients().unwrap()
    }
}

#[test_with(gpu)]
fn a_device_is_waited_for_only_where_it_is_asked() {
    let device = gpu();
    let mut fixture = Fixture { is_reported: false, ..Fixture::hull(0.0, 600) };
    let mut backend = backend(&device, &fixture, fixture.grids.clone()).unwrap();
    assert!(steps(&mut backend, &mut fixture, 12).is_none());
    assert_eq!(backend.kernels().reads(), 0);
    fixture.is_reported = true;
    assert!(steps(&mut backend, &mut fixture, 1).is_some());
    assert_eq!(backend.kernels().reads(), 1, "the losses of a step, at once");
    backend.grids().unwrap();
    assert_eq!(backend.kernels().reads(), 3, "the levels of shape and of colour");
    backend.shape_values().unwrap();
    assert_eq!(backend.kernels().reads(), 4, "the values of the shape alone");
}

#[test]
fn a_device_that_is_no_gpu_is_refused() {
    let fixture = Fixture::hull(0.0, 600);
    let refused = backend(&Device::flex(), &fixture, fixture.grids.clone());
    assert!(matches!(refused, Err(Error::Device(DeviceError::NoGpu))));
}

#[test_with(gpu)]
fn rays_beyond_the_memory_are_refused_with_their_size_and_the_device_is_still_good() {
    let device = gpu();
    let mut fixture = Fixture::hull(0.0, 600);
    let mut backend = backend(&device, &fixture, fixture.grids.clone()).unwrap();
    let sums = steps(&mut backend, &mut fixture, 1);
    let refused = backend.kernels_mut().reserve(1 << 40).map_err(|problem| problem.to_string());
    assert!(refused.is_err_and(|problem| problem.contains("MiB in one piece")));
    assert!(sums.is_some() && steps(&mut backend, &mut fixture, 1).is_some());
}

#[test_with(gpu)]
fn views_agree_as_far_as_on_the_cpu() {
    let device = gpu();
    // Right, of a hull that closes a mouth, in changed light, with other views of which some see nothing.
    for (radius, light) in [(0.3, 0.0), (0.4, 0.0), (0.3, 0.3), (0.29, 0.05)] {
        let mut fixture = Fixture::speckled_ball(radius, GridLosses::default());
        fixture.views[1].exposure = Exposure::from_logs([light; 3]);
        let on_gpu = backend(&device, &fixture, fixture.grids.clone()).unwrap();
        let on_cpu = CpuBackend::new(fixture.grids.clone());
        let ask = |backend: &dyn StepBackend| {
            backend.agreement(&fixture.views, &fixture.order, &fixture.config, fixture.rays_drawn).unwrap().0
        };
        let [found, expected] = [ask(&on_gpu), ask(&on_cpu)];
        println!("radius {radius}, light {light}: {found:.4}, on the CPU {expected:.4}");
        assert!((found - expected).abs() < 2e-3, "radius {radius}, light {light}: {found}, on the CPU {expected}");
        assert_eq!(on_gpu.kernels().reads(), 1, "what is found, and nothing of the shape");
    }
}
