//! What a backend says of a ray: what the kernel of rays writes, what the host reads, and what tests compare.

use crate::color::CHANNELS;
#[cfg(feature = "gpu")]
use crate::losses::LossSums;
use crate::losses::RayLosses;

/// The gradient that a ray sends to the field, at one point, and its losses. All zero where it sends none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "gpu", derive(bytemuck::Pod, bytemuck::Zeroable))]
#[repr(C)]
pub(crate) struct RayRecord {
    /// Where.
    pub point: [f32; 3],
    /// By the shape's value there.
    pub grad_value: f32,
    /// By the numbers of the colour there.
    pub grad_color: [f32; CHANNELS],
    /// Without their weights.
    pub losses: RayLosses,
    /// 1 where the ray hits and shows the object.
    pub intersection: f32,
    /// 1 where it does either.
    pub union: f32,
}

/// Numbers of a record.
#[cfg(feature = "gpu")]
pub(crate) const NUMBERS: usize = size_of::<RayRecord>() / 4;

/// Where the fields of a [`RayRecord`] lie among its numbers: what kernels write by.
#[cfg(feature = "gpu")]
pub(crate) mod numbers {
    use std::mem::offset_of;

    use super::RayRecord;

    pub(crate) const POINT: usize = offset_of!(RayRecord, point) / 4;
    pub(crate) const GRAD_VALUE: usize = offset_of!(RayRecord, grad_value) / 4;
    pub(crate) const GRAD_COLOR: usize = offset_of!(RayRecord, grad_color) / 4;
    pub(crate) const LOSSES: usize = offset_of!(RayRecord, losses) / 4;
    pub(crate) const INTERSECTION: usize = offset_of!(RayRecord, intersection) / 4;
    pub(crate) const UNION: usize = offset_of!(RayRecord, union) / 4;
}

#[cfg(feature = "gpu")]
impl RayRecord {
    /// Adds the losses to sums.
    pub fn add_to(&self, sums: &mut LossSums) {
        sums.add_ray(&self.losses);
        sums.intersection += usize::from(self.intersection > 0.0);
        sums.union += usize::from(self.union > 0.0);
    }
}
