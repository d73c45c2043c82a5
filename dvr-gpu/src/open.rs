//! Opening a GPU, with an error where that fails instead of a panic at the first tensor.

use std::sync::{Mutex, PoisonError};

use burn::backend::DispatchDevice;
use burn::tensor::Device;
use cubecl::client::Client;
use cubecl::wgpu::{AutoGraphicsApi, RuntimeOptions, try_init_setup};

use crate::adapter::{Adapter, AdapterKind, adapters};

/// An open GPU.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// The device for tensors, without autodiff.
    pub device: Device,
    /// What it is.
    pub adapter: Adapter,
}

/// Why no GPU could be opened.
#[derive(Debug, thiserror::Error)]
pub enum GpuError {
    /// There is none, or no driver for it.
    #[error("no GPU was found: no Vulkan, Metal or DirectX 12 driver offers one")]
    NoAdapter,
    /// There are some, but not as many.
    #[error("there is no gpu:{index}: {count} found, counted from 0")]
    NoSuchAdapter {
        /// The one that was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// CUDA has no such card, or is not installed.
    #[cfg(feature = "cuda")]
    #[error("there is no cuda:{index}: CUDA finds {count}, counted from 0")]
    NoCuda {
        /// The one that was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// The driver refuses.
    #[error("gpu:{index} ({name}) cannot be opened: {problem}")]
    Refused {
        /// The one that was asked for.
        index: usize,
        /// Its name.
        name: String,
        /// What the driver says.
        problem: String,
    },
}

/// Opens one of [`adapters`]. One that is open already is handed out again.
///
/// # Errors
/// When there is none with this index, or the driver refuses to open it.
pub fn open(index: usize) -> Result<Gpu, GpuError> {
    static OPEN: Mutex<Vec<usize>> = Mutex::new(Vec::new());
    let count = adapters().len();
    let adapter = match adapters().get(index) {
        Some(adapter) => adapter.clone(),
        None if count == 0 => return Err(GpuError::NoAdapter),
        None => return Err(GpuError::NoSuchAdapter { index, count }),
    };
    let refused = |problem: String| GpuError::Refused { index, name: adapter.name.clone(), problem };
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    if !open.contains(&index) {
        let options = RuntimeOptions::try_default().map_err(|e| refused(e.to_string()))?;
        try_init_setup::<AutoGraphicsApi>(&adapter.selector, options).map_err(|e| refused(e.to_string()))?;
        open.push(index);
    }
    Ok(Gpu { device: Device::from(adapter.selector.clone()), adapter })
}

/// What talks to a GPU; `None` where the device is not a GPU.
pub(crate) fn client(device: &Device) -> Option<Client> {
    match device.clone().inner().as_dispatch() {
        DispatchDevice::Cube(device) => Some(device.client()),
        _ => None,
    }
}

/// Whether tensors of this device, with or without autodiff, lie on a GPU.
pub fn is_gpu(device: &Device) -> bool {
    matches!(device.clone().inner().as_dispatch(), DispatchDevice::Cube(_))
}

/// Whether tensors of this device lie with a program that emulates a GPU: far slower than the CPU by itself.
pub fn is_software(device: &Device) -> bool {
    let DispatchDevice::Cube(device) = device.clone().inner().as_dispatch().clone() else { return false };
    let software = adapters().iter().filter(|adapter| adapter.kind == AdapterKind::Software);
    software.into_iter().any(|adapter| device == adapter.selector.clone().into())
}

/// The NVIDIA cards that CUDA knows: how many there are. None where CUDA is not installed.
#[cfg(feature = "cuda")]
pub fn cuda_devices() -> usize {
    cubecl::Device::enumerate_all().iter().filter(|device| matches!(device, cubecl::Device::Cuda(_))).count()
}

/// Opens an NVIDIA card through CUDA, by its place there.
///
/// # Errors
/// When CUDA is not installed, or has no such card.
#[cfg(feature = "cuda")]
pub fn open_cuda(index: usize) -> Result<Device, GpuError> {
    let device = cubecl::Device::cuda(index).map_err(|_| GpuError::NoCuda { index, count: cuda_devices() })?;
    Ok(Device::from(DispatchDevice::Cube(device)))
}
