//! Work cut into chunks that suit a device: small ones on all cores of a CPU, large ones one after the other on a GPU.

use burn::tensor::Device;
use rayon::prelude::*;

/// Whether tensors of a device lie on a GPU: then they are worth handling in large pieces, and reading a
/// number back makes the program wait for all that was asked before.
pub fn is_gpu(device: &Device) -> bool {
    #[cfg(feature = "gpu")]
    return dvr_gpu::is_gpu(device);
    #[cfg(not(feature = "gpu"))]
    {
        let _ = device;
        false
    }
}

/// Where a GPU holds more memory than it may: bytes held, and bytes allowed. See
/// `dvr_gpu::limit_memory`.
pub fn memory_excess(device: &Device) -> Option<(u64, u64)> {
    #[cfg(feature = "gpu")]
    return dvr_gpu::memory_excess(device).map(|excess| (excess.held, excess.allowed));
    #[cfg(not(feature = "gpu"))]
    {
        let _ = device;
        None
    }
}

/// How many points to evaluate at once: `on_cpu`, or as many as a GPU's memory has room for.
pub(crate) fn points_at_once(device: &Device, on_cpu: usize) -> usize {
    #[cfg(feature = "gpu")]
    if let Some(points) = dvr_gpu::points_at_once(device) {
        return points;
    }
    let _ = device;
    on_cpu
}

/// `(start, length)` of consecutive chunks of at most `size` that cover `0..n`.
pub(crate) fn chunks(n: usize, size: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).step_by(size).map(move |start| (start, size.min(n - start)))
}

/// Does jobs and returns the results in their order. A GPU has one queue, and each thread that uses it would claim
/// memory of its own: there the jobs are done in turn.
pub(crate) fn in_parallel<J: Send, T: Send>(device: &Device, jobs: Vec<J>, work: impl Fn(J) -> T + Sync) -> Vec<T> {
    if is_gpu(device) { jobs.into_iter().map(work).collect() } else { jobs.into_par_iter().map(&work).collect() }
}
