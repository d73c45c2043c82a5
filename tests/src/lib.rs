//! What the tests of several crates share: arrays of DVR's reference code, rendered scenes, and devices.
//!
//! What a machine may lack is found through `dvr-test-support`.

mod bound_decoder;
mod counted;
mod field_suite;
pub mod fuzz;
mod pytorch_file;

use burn::module::{Module, ModuleMapper, Param};
use burn::tensor::{DType, Device, FloatDType, Int, Tensor, TensorData};
use dvr_core::Scene;
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{Mesh, TexturedMesh};
use dvr_core::npz::NpzFile;
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_model::{Decoder, DecoderConfig};

pub use bound_decoder::BoundDecoder;
pub use counted::Counted;
pub use dvr_test_support::{
    browser, fixture, large_fixture, largest, max_difference, mounts, relative_difference, scene, test_with,
};
pub use field_suite::check_field;
pub use pytorch_file::{Entry, write_pytorch};

/// A module whose parameters are burn's random numbers on the CPU from a seed on. Other tests draw from the same generator
/// meanwhile: all make their modules through this function.
pub fn seeded<M: Module>(seed: u64, make: impl FnOnce() -> M) -> M {
    dvr_model::seeded(&Device::flex(), seed, make)
}

/// Arrays that DVR's reference code computed.
pub struct Fixture(NpzFile);

impl Fixture {
    /// Opens `<name>.npz`.
    pub fn open(name: &str) -> Self {
        Self(NpzFile::open(&fixture(&format!("{name}.npz"))).unwrap_or_else(|e| panic!("{e}")))
    }

    /// Names of all arrays.
    pub fn names(&self) -> Vec<String> {
        self.0.names().to_vec()
    }

    /// Whether there is an array of that name.
    pub fn contains(&self, name: &str) -> bool {
        self.0.contains(name)
    }

    /// An array as numbers.
    pub fn numbers(&mut self, name: &str) -> Vec<f64> {
        self.0.read(name).unwrap_or_else(|e| panic!("{e}")).to_f64()
    }

    /// An array as truth values.
    pub fn truths(&mut self, name: &str) -> Vec<bool> {
        self.0.read(name).unwrap_or_else(|e| panic!("{e}")).to_bool()
    }

    /// An array of one number.
    pub fn number(&mut self, name: &str) -> f64 {
        self.numbers(name)[0]
    }

    /// An array as points.
    pub fn points(&mut self, name: &str) -> Vec<[f64; 3]> {
        self.numbers(name).chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect()
    }
}

/// The fixtures' decoder with a code of length `code_dim` (0 or 32), with parameters of the device's float type.
pub fn fixture_decoder(code_dim: usize, device: &Device) -> (DecoderConfig, Decoder) {
    let path = fixture(&format!("decoder_c{code_dim}_h64.safetensors"));
    let (config, decoder) = dvr_model::load_safetensors(&path, device).unwrap_or_else(|e| panic!("{e}"));
    let dtype = Tensor::<1>::zeros([1], device).dtype();
    (config, decoder.map(&mut CastTo(dtype)))
}

/// Casts all float parameters.
struct CastTo(DType);

impl ModuleMapper for CastTo {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let dtype = FloatDType::from(self.0);
        param.map(|tensor| {
            let tracked = tensor.is_require_grad();
            tensor.detach().cast(dtype).set_require_grad(tracked)
        })
    }
}

/// `[n, 3]` points on a device.
pub fn tensor3(points: &[[f64; 3]], device: &Device) -> Tensor<2> {
    let values: Vec<f64> = points.iter().flatten().copied().collect();
    Tensor::from_data(TensorData::new(values, [points.len(), 3]), device)
}

/// `[n]` numbers on a device.
pub fn tensor1(values: &[f64], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), device)
}

/// A matrix of `width` columns on a device.
pub fn rows(values: &[f64], width: usize, device: &Device) -> Tensor<2> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len() / width, width]), device)
}

/// Object index of each of `n` points in `batch` equal groups.
pub fn groups(n: usize, batch: usize, device: &Device) -> Tensor<1, Int> {
    let index: Vec<i64> = (0..n).map(|i| (i / (n / batch)) as i64).collect();
    Tensor::from_data(TensorData::new(index, [n]), device)
}

/// A tensor's numbers.
pub fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().iter::<f64>().collect()
}

/// The CPU in double precision. The choice holds for the whole process: only for tests with a binary of their own.
pub fn double_precision_device() -> Device {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| Device::flex().configure(FloatDType::F64).unwrap_or_else(|e| panic!("{e:?}")));
    Device::flex()
}

/// A scene of an object, rendered from `views` sides at `pixels` by `pixels`, as it is read from the disk.
pub fn rendered_scene(mesh: Mesh, views: usize, pixels: u32) -> Scene {
    let folder = tempfile::tempdir().expect("there is room for temporary files");
    let object = TexturedMesh { mesh, ..TexturedMesh::default() };
    let config = SynthConfig {
        views,
        width: pixels,
        height: pixels,
        surface_points: 100,
        occupancy_points: 100,
        ..SynthConfig::default()
    };
    render_dataset(&object, "object", "objects", folder.path(), &config, &|_, _| ())
        .expect("the object can be rendered");
    read_scene(&folder.path().join("objects/object"), &ReadOptions::default()).expect("what was written can be read")
}

/// The GPU that the suites run on, for tests marked `test_with(gpu)`. A software adapter will do.
pub fn gpu() -> Device {
    let gpu = dvr_test_support::gpu(dvr_gpu::open(0));
    println!("on {} ({}, {})", gpu.adapter.name, gpu.adapter.kind, gpu.adapter.api);
    gpu.device
}
