//! Stereo on a GPU: where rays lie in the hull, costs of depths, and semi-global matching as kernels.
//!
//! Each file is the counterpart of one beside this folder: `ranges` of `hull`, `sweep` of `sweep` and
//! `correlation`, `semi_global` of `semi_global` and of the choice of a depth in `cost_volume`. Sums of patches are added in
//! another order than on the CPU, so depths are the same but for rounding, and where two cost as good as the same.

mod depth_maps;
mod ranges;
mod semi_global;
mod sweep;

pub(super) use depth_maps::depth_maps;
