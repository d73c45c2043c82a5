//! Depth: where a ray meets the surface against the depth map, in L1.
//!
//! `L = weight * |w| |d - d_map|`: ray depth is z-depth, and a step of it is as long in space as the ray's direction `w`
//! (of unit z). Pixels where nothing was measured are left out.

use serde::{Deserialize, Serialize};

use super::term::{LossTerm, SurfaceGradient, SurfaceHit, SurfaceTerm};

/// Depth of hits against depth maps, L1, in object units.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DepthLoss {
    /// Weight of the mean over rays.
    pub weight: f64,
}

impl LossTerm for DepthLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        Self { weight: 1.0 }
    }
}

impl SurfaceTerm for DepthLoss {
    fn evaluate(&self, hit: &SurfaceHit, gradient: &mut SurfaceGradient) -> f64 {
        if !hit.pixel.z_depth.is_finite() {
            return 0.0;
        }
        let error = hit.depth - hit.pixel.z_depth;
        let length = hit.pixel.direction.length();
        gradient.grad_depth += self.weight as f32 * length * error.signum();
        f64::from(error.abs() * length)
    }
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::super::term::gpu::{PixelRay, SurfaceGradient, SurfaceHit};
    use super::DepthLoss;
    use crate::gpu::traversal::FAR;

    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Weights {
        pub weight: f32,
    }

    impl DepthLoss {
        pub(crate) fn launch(&self) -> WeightsLaunch {
            WeightsLaunch { weight: self.weight as f32 }
        }
    }

    #[cube]
    pub(crate) fn evaluate(weights: &Weights, pixel: &PixelRay, hit: &SurfaceHit, gradient: &SurfaceGradient) -> f32 {
        let mut value = 0.0f32;
        // Beyond everything where nothing was measured.
        if pixel.z_depth.abs() < f32::new(FAR) {
            let error = hit.depth - pixel.z_depth;
            let length = pixel.direction.length();
            gradient.add_depth(weights.weight * length * select(error < 0.0f32, -1.0f32, 1.0f32));
            value = error.abs() * length;
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::term::tests::{evaluated, pixel};
    use super::*;

    #[test]
    fn it_is_the_distance_on_the_ray_from_either_side_and_nothing_where_nothing_was_measured() {
        let loss = DepthLoss { weight: 3.0 };
        assert_eq!(evaluated(&loss, &pixel(1.5)), (0.75, 4.5, Vec3::ZERO));
        assert_eq!(evaluated(&loss, &pixel(4.0)), (3.0, -4.5, Vec3::ZERO));
        for unmeasured in [f32::NAN, f32::INFINITY] {
            assert_eq!(evaluated(&loss, &pixel(unmeasured)), (0.0, 0.0, Vec3::ZERO));
        }
    }
}
