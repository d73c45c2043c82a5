//! The start on a GPU: each file is the counterpart of one of the same name beside this folder.

mod mask_distances;
mod plane_sweep;

pub(super) use mask_distances::GpuMasks;
pub(super) use plane_sweep::depths;
