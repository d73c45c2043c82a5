//! `--memory`, and what the machine has: work that would take more is refused before it starts.
//!
//! On the CPU the flag limits what the process takes; photographs beyond it are paged. On a GPU it limits the tensors
//! there, and the photographs.

use anyhow::Result;
use burn::tensor::Device;
use dvr_core::{Camera, Scene};
use dvr_render::extract::ExtractSettings;
use dvr_render::{is_gpu, rendering_bytes};
use dvr_train::{HostMemory, MemoryShares, MeshOptions, Method, check_host_memory, check_memory};

/// Limits the GPU memory of tensors to `--memory`.
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

/// Makes room for a run on a scene: photographs that leave too little go into a scratch file. Returns what the run takes,
/// about, and what it may.
///
/// # Errors
/// When there is not enough memory all the same.
pub fn make_room(
    scene: &mut Scene,
    method: &dyn Method,
    mesh: &MeshOptions,
    device: &Device,
    memory: Option<u64>,
) -> Result<(HostMemory, MemoryShares)> {
    let needed = HostMemory::of_run(method, scene, mesh);
    let shares = share(scene, needed, of_process(device, memory))?;
    Ok((needed.bounded(shares), shares))
}

/// The same for a mesh of a run, whose options it returns with a bound for the texture.
///
/// # Errors
/// As [`make_room`].
pub fn make_room_for_mesh(
    scene: &mut Scene,
    mesh: MeshOptions,
    device: &Device,
    memory: Option<u64>,
) -> Result<MeshOptions> {
    let needed = HostMemory::of_mesh(scene, &mesh);
    let shares = share(scene, needed, of_process(device, memory))?;
    Ok(mesh.with_texture_within(shares.texture))
}

/// The same for a texture of which this is needed, whose bound in bytes it returns.
///
/// # Errors
/// As [`make_room`].
pub fn make_room_for_texture(scene: &mut Scene, needed: HostMemory, memory: Option<u64>) -> Result<u64> {
    Ok(share(scene, needed, memory)?.texture)
}

/// The same for finding masks.
///
/// # Errors
/// As [`make_room`].
pub fn make_room_for_masks(scene: &mut Scene, memory: Option<u64>) -> Result<()> {
    let needed = HostMemory::of_work(scene, dvr_segmentation::memory_estimate(&scene.views));
    share(scene, needed, memory).map(|_| ())
}

/// Puts photographs into a scratch file that are beyond their share.
fn share(scene: &mut Scene, needed: HostMemory, allowed: Option<u64>) -> Result<MemoryShares> {
    let shares = needed.within(allowed)?;
    if needed.photographs > shares.photographs {
        scene.keep_in_memory(shares.photographs)?;
    }
    Ok(shares)
}

/// Refuses training on a dataset of objects where a step would not fit.
///
/// # Errors
/// When there is not enough memory.
pub fn check_objects(method: &dyn Method, device: &Device, memory: Option<u64>) -> Result<()> {
    Ok(check_host_memory(method.host_memory(&[]), of_process(device, memory))?)
}

/// Refuses an extraction for which there is not enough memory.
///
/// # Errors
/// When there is not enough memory.
pub fn check_extraction(settings: &ExtractSettings, device: &Device, memory: Option<u64>) -> Result<()> {
    Ok(check_host_memory(settings.memory_estimate(), of_process(device, memory))?)
}

/// Refuses renders for which there is not enough memory.
///
/// # Errors
/// When there is not enough memory.
pub fn check_rendering<'a>(
    cameras: impl Iterator<Item = &'a Camera>,
    device: &Device,
    memory: Option<u64>,
) -> Result<()> {
    let bytes = cameras.map(rendering_bytes).max().unwrap_or(0);
    Ok(check_host_memory(bytes, of_process(device, memory))?)
}

/// `--memory` where it limits the process.
pub fn of_process(device: &Device, memory: Option<u64>) -> Option<u64> {
    memory.filter(|_| !is_gpu(device))
}
