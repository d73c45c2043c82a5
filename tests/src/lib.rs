//! What the tests of several crates share: the fixtures and scenes that lie beside the checkout, and devices.
//!
//! `../shared` holds arrays that the PyTorch original computed, and scenes. It is not part of the project: where it is
//! missing, tests say that they were skipped, and pass.

mod pytorch_file;

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{DType, Device, FloatDType, Tensor, TensorData};
use dvr_core::Scene;
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{Mesh, TexturedMesh};
use dvr_core::npz::NpzFile;
use dvr_core::synth::{SynthConfig, render_dataset};
use dvr_model::{Decoder, DecoderConfig};

pub use pytorch_file::{Entry, write_pytorch};

/// The folder beside the checkout, or `None` (with a line of output) where it is missing.
pub fn shared(part: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared")).join(part);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {} is not here", path.display());
    None
}

/// A module whose parameters are burn's random numbers on the CPU from a seed on. These are those of the whole process:
/// whatever else draws some meanwhile, in another test, must do so through this, too.
pub fn seeded<M: Module>(seed: u64, make: impl FnOnce() -> M) -> M {
    static TURN: Mutex<()> = Mutex::new(());
    // A test that failed while it had them has told so.
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    Device::flex().seed(seed);
    let module = make();
    module.visit(&mut DrawnNow);
    module
}

/// Parameters draw their numbers when they are first looked at.
struct DrawnNow;

impl ModuleVisitor for DrawnNow {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        param.val();
    }
}

/// Arrays that the original computed.
pub struct Fixture(NpzFile);

impl Fixture {
    /// Opens `../shared/fixtures/<name>.npz`, or `None` where the folder is missing.
    pub fn open(name: &str) -> Option<Self> {
        let path = shared("fixtures")?.join(format!("{name}.npz"));
        Some(Self(NpzFile::open(&path).unwrap_or_else(|e| panic!("{e}"))))
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
pub fn fixture_decoder(code_dim: usize, device: &Device) -> Option<(DecoderConfig, Decoder)> {
    let path = shared("fixtures")?.join(format!("decoder_c{code_dim}_h64.safetensors"));
    let (config, decoder) = dvr_model::load_safetensors(&path, device).unwrap_or_else(|e| panic!("{e}"));
    let dtype = Tensor::<1>::zeros([1], device).dtype();
    Some((config, decoder.map(&mut CastTo(dtype))))
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

/// A tensor's numbers.
pub fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().iter::<f64>().collect()
}

/// Largest absolute difference.
pub fn max_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// `|a - b| / |b|` in the Euclidean norm.
pub fn relative_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut a.iter().zip(b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied()).max(f64::MIN_POSITIVE)
}

/// The devices that the suites run on, in single precision.
// Upstream deprecates burn-ndarray; here it is the second oracle.
#[allow(deprecated)]
pub fn devices() -> Vec<(&'static str, Device)> {
    vec![("flex", Device::flex()), ("ndarray", Device::ndarray())]
}

/// The same in double precision. The choice holds for the whole process: only for tests with a binary of their own.
pub fn double_precision_devices() -> Vec<(&'static str, Device)> {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        for (_, mut device) in devices() {
            device.configure(FloatDType::F64).unwrap_or_else(|e| panic!("{e:?}"));
        }
    });
    devices()
}

/// A scene of an object, rendered from so many sides at so many pixels, as it is read from the disk.
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

/// The graphics processor that the suites run on, or `None` (with a line of output) where no driver offers one. A
/// software adapter will do.
pub fn graphics_processor() -> Option<Device> {
    match dvr_gpu::open(0) {
        Ok(gpu) => {
            println!("on {} ({}, {})", gpu.adapter.name, gpu.adapter.kind, gpu.adapter.api);
            Some(gpu.device)
        }
        Err(problem) => {
            println!("skipped: {problem}");
            None
        }
    }
}
