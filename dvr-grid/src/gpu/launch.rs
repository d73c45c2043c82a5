//! How kernels are launched, and what they all use.

use cubecl::calculate_cube_count_elemwise;
use cubecl::prelude::*;

/// Work-items per group.
pub(crate) const UNITS: usize = 64;

/// The index of nothing: no view to compare with, a node without parameters.
pub(crate) const NONE: u32 = u32::MAX;

/// Groups for this many work-items.
pub(crate) fn groups(client: &Client, count: usize) -> CubeCount {
    calculate_cube_count_elemwise(client, count.max(1), units())
}

/// The shape of a group.
pub(crate) fn units() -> CubeDim {
    CubeDim::new_1d(UNITS as u32)
}
