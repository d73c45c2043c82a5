//! Weights of the losses, as kernels are given them.

#![allow(missing_docs)]

use cubecl::prelude::*;

/// Weights of the losses.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct Weights {
    pub color: f32,
    pub texture: f32,
    pub photo_consistency: f32,
    pub photo_consistency_limit: f32,
    pub patch_ncc: f32,
    pub patch_ncc_min: f32,
    pub patch_stride: u32,
    pub depth: f32,
    pub mask: f32,
    pub sharpness: f32,
    /// Cosine at which slopes of grazing rays are damped.
    pub grazing: f32,
    /// What a sum over compared views is divided by.
    pub compared: f32,
}
