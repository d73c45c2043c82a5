//! Weights of the losses, as kernels are given them.

#![allow(missing_docs)]

use cubecl::prelude::*;

/// Weights of the losses.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(super) struct Weights {
    pub color: f32,
    pub texture: f32,
    pub cross_view: f32,
    pub cross_view_limit: f32,
    pub structure: f32,
    pub structure_limit: f32,
    pub structure_stride: u32,
    pub depth: f32,
    pub mask: f32,
    pub sharpness: f32,
    /// Cosine at which slopes of grazing rays are damped.
    pub grazing: f32,
    /// What a sum over compared views is divided by.
    pub compared: f32,
}
