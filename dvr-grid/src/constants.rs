//! Numbers of a step that CPU and GPU share, besides those of the losses.

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
