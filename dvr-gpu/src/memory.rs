//! Memory of GPUs: how much of it there may be used, and how work is cut to keep to that.

use std::sync::atomic::{AtomicU64, Ordering};

use burn::backend::{Backend, Cube};
use burn::tensor::Device;

use crate::open::{client, is_gpu};

/// A device, as its backend calls it.
pub type CubeDevice = burn::backend::tensor::Device<Cube>;

/// Bytes that each device of this process may take; all that there are until somebody says otherwise.
static LIMIT: AtomicU64 = AtomicU64::new(u64::MAX);

/// From here on, work on GPUs is cut so that the tensors of each take at most `bytes` bytes.
pub fn limit_memory(bytes: u64) {
    LIMIT.store(bytes, Ordering::Relaxed);
}

/// More memory than allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryExcess {
    /// Bytes that the device has set aside for tensors.
    pub held: u64,
    /// Bytes that [`limit_memory`] allows.
    pub allowed: u64,
}

/// Bytes that a device has set aside for tensors: those in use, and what it keeps to use again. `None` where it is not a
/// GPU.
pub fn memory_held(device: &Device) -> Option<u64> {
    is_gpu(device).then(|| device.clone().inner().memory_pool_usage())?.map(|usage| usage.bytes_reserved)
}

/// Whether a device holds more than [`limit_memory`] allows. One that comes near gives back what it does not use.
pub fn memory_excess(device: &Device) -> Option<MemoryExcess> {
    let allowed = LIMIT.load(Ordering::Relaxed);
    if allowed == u64::MAX {
        return None;
    }
    let held = memory_held(device)?;
    if held > allowed / 4 * 3 {
        device.clone().inner().memory_cleanup();
    }
    (held > allowed).then_some(MemoryExcess { held, allowed })
}

/// Bytes that tensors hold and bytes allowed, where `more` would be too many. Of little it is not asked: that
/// would take longer than what it is wanted for.
pub(crate) fn beyond_limit(device: &CubeDevice, more: u64) -> Option<(u64, u64)> {
    let allowed = LIMIT.load(Ordering::Relaxed);
    if allowed == u64::MAX || more < LITTLE {
        return None;
    }
    let held = Cube::memory_pool_usage(device)?.bytes_in_use;
    (held + more > allowed).then_some((held, allowed))
}

/// Bytes that need not be asked for.
const LITTLE: u64 = 1 << 16;

/// How many rows of `bytes` bytes to handle at once where each is little work: enough to keep a card busy, and within a
/// quarter of what [`limit_memory`] allows.
pub fn rows_at_once(bytes: u64) -> usize {
    let allowed = LIMIT.load(Ordering::Relaxed) / 4 / bytes.max(1);
    usize::try_from(allowed).unwrap_or(usize::MAX).clamp(1 << 10, 1 << 18)
}

/// How many points a network is best asked at once on this device; `None` where it is not a GPU.
///
/// Enough to keep it busy, and few enough that no buffer comes near the largest that it can take, that of a small
/// card's memory, or what [`limit_memory`] allows.
pub fn points_at_once(device: &Device) -> Option<usize> {
    Some(points_within(client(device)?.properties().memory.max_page_size, LIMIT.load(Ordering::Relaxed)))
}

/// Numbers of the widest layer in use.
const WIDEST: u64 = 512;

/// Layers that are alive at a time while a network's values and its derivatives along three axes are computed: of each
/// the layer, what goes into the next one, and its mask.
const LAYERS_ALIVE: u64 = 16;

/// Points at once, if no buffer may be larger than an eighth of `largest`, and all together take half of `allowed`
/// (both in bytes).
fn points_within(largest: u64, allowed: u64) -> usize {
    let by_buffer = (largest / (8 * 4 * WIDEST)).clamp(1 << 12, 1 << 16);
    let by_limit = (allowed / (2 * 4 * WIDEST * LAYERS_ALIVE)).max(1 << 6);
    usize::try_from(by_buffer.min(by_limit)).unwrap_or(1 << 12)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_stay_below_an_eighth_of_the_largest_and_all_together_below_half_of_the_limit() {
        const GIB: u64 = 1 << 30;
        assert_eq!(points_within(2 * GIB, u64::MAX), 1 << 16, "128 MiB a layer");
        assert_eq!(points_within(GIB / 8, u64::MAX), 1 << 13);
        assert_eq!(points_within(0, u64::MAX), 1 << 12, "any device can do so much");
        assert_eq!(points_within(2 * GIB, GIB), 1 << 14);
        assert_eq!(points_within(2 * GIB, 64 << 20), 1 << 10);
        assert_eq!(points_within(2 * GIB, 0), 1 << 6, "and some points it must be");
    }
}
