//! Numbers that training of fields on grids keeps to wherever it is carried out, on the processor or on a device.

/// Decay of Adam's running mean of the gradient.
pub const BETA1: f32 = 0.9;

/// Decay of Adam's running mean of the gradient's square: shorter than usual, since a run has hundreds of steps, not
/// thousands.
pub const BETA2: f32 = 0.99;

/// Added to the root of Adam's second mean.
pub const EPSILON: f32 = 1e-10;

/// Cosine between normal and line of sight below which another view is not asked.
pub const MIN_COSINE: f32 = 0.15;

/// Cells that a line of sight leaves the surface by before it is tested for occlusion.
pub const CLEARANCE: f32 = 1.5;

/// Nodes whose value is at most so many spacings from zero count as near the surface, where smoothness is measured.
pub const NEAR: f32 = 2.0;

/// Samples along the side of a patch that is compared between views.
pub const PATCH_SIDE: usize = 3;

/// Variance of brightness that noise alone may have: patches with less say nothing.
pub const PATCH_NOISE: f32 = 1e-4;

/// How much nearer or farther than the middle of a patch a sample may lie, as a factor: planes seen edge-on reach too
/// far.
pub const MAX_STRETCH: f32 = 1.15;
