//! Photo-consistency: the pixel's colour against what other views show at the hit, in L1.
//!
//! `L = weight * mean_v |I_v(pi_v(p(d))) - c_pixel|_1` over the views compared with, whose pictures are sampled
//! bilinearly: photo-consistency (Kutulakos and Seitz 2000) as a functional of the surface (Faugeras and Keriven 1998).
//! It makes the surface right where it has texture. Residuals above a limit are taken for occlusion or highlights, and
//! ignored.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::term::{Comparison, CrossViewTerm, LossTerm, SurfaceHit};
use crate::views::TrainingView;

/// Colour of the pixel against other views' pictures at the hit, L1: what makes the surface right where it has texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhotoConsistencyLoss {
    /// Weight of the mean over rays and the views they are compared with.
    pub weight: f64,
    /// Residuals above this are taken for occlusion or highlights, and ignored.
    pub limit: f64,
}

impl Default for PhotoConsistencyLoss {
    fn default() -> Self {
        Self { weight: 10.0, limit: 0.1 }
    }
}

impl LossTerm for PhotoConsistencyLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    fn parameters(&self) -> Vec<(&'static str, f64, RangeInclusive<f64>)> {
        vec![("limit", self.limit, 0.0..=f64::MAX)]
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        // No residual of three channels in [0, 1] is larger.
        Self { weight: 1.0, limit: 3.0 }
    }
}

impl CrossViewTerm for PhotoConsistencyLoss {
    type Prepared = ();

    fn prepare(&self, _own: &TrainingView, _hit: &SurfaceHit) -> Option<()> {
        Some(())
    }

    fn compare(&self, _prepared: &(), hit: &SurfaceHit, other: &Comparison, grad_depth: &mut f32) -> f64 {
        let residual = other.seen.color - hit.pixel.color;
        let size = residual.abs().element_sum();
        if size < self.limit as f32 {
            *grad_depth += self.weight as f32 * residual.signum().dot(other.seen.derivative);
            f64::from(size)
        } else {
            0.0
        }
    }
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::super::term::gpu::{PixelRay, SurfaceHit};
    use super::PhotoConsistencyLoss;
    use crate::gpu::views::{Photo, Seen};

    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Weights {
        pub weight: f32,
        pub limit: f32,
    }

    impl PhotoConsistencyLoss {
        pub(crate) fn launch(&self) -> WeightsLaunch {
            WeightsLaunch { weight: self.weight as f32, limit: self.limit as f32 }
        }
    }

    #[derive(CubeType)]
    pub(crate) struct Prepared {
        is_active: bool,
    }

    #[cube]
    pub(crate) fn prepare(
        weights: &Weights,
        _views: &[u32],
        _pixels: &[u32],
        _pixel: &PixelRay,
        _hit: &SurfaceHit,
    ) -> Prepared {
        Prepared { is_active: weights.weight > 0.0f32 }
    }

    #[cube]
    pub(crate) fn compare(
        weights: &Weights,
        prepared: &Prepared,
        _views: &[u32],
        _pixels: &[u32],
        pixel: &PixelRay,
        _other: &Photo,
        seen: &Seen,
        grad_depth: &RuntimeCell<f32>,
    ) -> f32 {
        let residual = seen.color.minus(&pixel.color);
        let size = residual.size();
        let mut value = 0.0f32;
        if prepared.is_active && size < weights.limit {
            grad_depth.store(grad_depth.read() + weights.weight * residual.signs().dot(&seen.derivative));
            value = size;
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::GridLosses;
    use super::super::term::tests::pixel;
    use super::*;
    use crate::color::ColorSample;
    use crate::step::suite::Fixture;
    use crate::views::Reprojection;

    #[test]
    fn differences_below_the_limit_pull_by_their_signs_and_larger_ones_do_not() {
        let fixture = Fixture::ball(0.3, GridLosses::default());
        let pixel = pixel(f32::NAN);
        let nothing = ColorSample { color: Vec3::ZERO, derivative: Vec3::ZERO };
        let hit = SurfaceHit {
            pixel: &pixel,
            origin: Vec3::ZERO,
            depth: 1.0,
            point: Vec3::Z,
            inward: Vec3::Z,
            color: nothing,
        };
        let seen = Reprojection { color: Vec3::new(0.4, 0.25, 0.85), derivative: Vec3::new(1.0, 10.0, 100.0) };
        let pulled = |limit: f64| {
            let mut gradient = 5.0;
            let other = Comparison { view: &fixture.views[0], seen };
            let value = PhotoConsistencyLoss { weight: 3.0, limit }.compare(&(), &hit, &other, &mut gradient);
            (value, gradient - 5.0)
        };
        let (value, gradient) = pulled(0.21);
        assert!((value - 0.2).abs() < 1e-6, "{value}");
        assert_eq!(gradient, 3.0 * (-1.0 + 10.0 - 100.0));
        assert_eq!(pulled(0.19), (0.0, 0.0));
    }
}
