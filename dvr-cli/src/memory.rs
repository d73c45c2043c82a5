//! `--memory` on a GPU.

use anyhow::Result;
use burn::tensor::Device;
use dvr_render::is_gpu;
use dvr_train::{Method, check_memory};

/// Limits the GPU memory of tensors to `--memory`. On the CPU the flag concerns photographs alone.
pub fn limit(device: &Device, memory: Option<u64>) {
    #[cfg(feature = "gpu")]
    if let Some(bytes) = memory.filter(|_| is_gpu(device)) {
        dvr_gpu::limit_memory(bytes);
    }
    #[cfg(not(feature = "gpu"))]
    let _ = (device, memory);
}

/// The same for training, which is refused where a step would not fit.
///
/// # Errors
/// Says how many rays a step may have.
pub fn limit_training(device: &Device, memory: Option<u64>, method: &dyn Method) -> Result<()> {
    limit(device, memory);
    match memory.filter(|_| is_gpu(device)) {
        Some(bytes) => Ok(check_memory(method, bytes)?),
        None => Ok(()),
    }
}
