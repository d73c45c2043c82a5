//! The ways to reconstruct a scene, or to learn from many.

pub(crate) mod memory_estimate;
pub(crate) mod method;
pub(crate) mod trained_model;
