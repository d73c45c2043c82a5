//! The slope rule inside a kernel: the counterpart of `dvr_render::SlopeRule`.

#![allow(missing_docs)]

use cubecl::prelude::*;
use dvr_render::SlopeRule;

/// How the gradient of a depth is damped at grazing rays.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct SlopeRuleArgs {
    /// 1 for the scale-free rule, 0 for the classic one.
    pub is_scale_free: u32,
    pub epsilon: f32,
}

impl SlopeRuleArgsLaunch {
    pub fn of(rule: SlopeRule) -> Self {
        match rule {
            SlopeRule::ScaleFree { epsilon } => Self { is_scale_free: 1, epsilon: epsilon as f32 },
            SlopeRule::Classic { epsilon } => Self { is_scale_free: 0, epsilon: epsilon as f32 },
        }
    }
}

#[cube]
impl SlopeRuleArgs {
    /// The regularised inverse of a slope, given also the product of the lengths of gradient and direction.
    pub fn inverse_slope(&self, slope: f32, scale: f32) -> f32 {
        let held = scale.max(1e-20f32);
        let cosine = slope / held;
        let scale_free = cosine / (cosine * cosine + self.epsilon * self.epsilon) / held;
        let classic = 1.0f32 / select(slope.abs() < self.epsilon, self.epsilon, slope);
        select(self.is_scale_free > 0u32, scale_free, classic)
    }
}
