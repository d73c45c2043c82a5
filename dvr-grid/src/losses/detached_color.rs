//! Detached colour: the same residual as [`super::color`], with the surface held still.
//!
//! `L = weight * |c(stop_gradient(p)) - c_pixel|_1`: colours learn from the photograph, the surface does not. For runs
//! whose shape is the business of depth maps alone.

use serde::{Deserialize, Serialize};

use super::term::{LossTerm, SurfaceGradient, SurfaceHit, SurfaceTerm};

/// Colour of hits against their pixels, L1, with the surface held still: the colour alone learns from it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetachedColorLoss {
    /// Weight of the mean over rays.
    pub weight: f64,
}

impl LossTerm for DetachedColorLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        Self { weight: 1.0 }
    }

    #[cfg(test)]
    fn is_detached() -> bool {
        true
    }
}

impl SurfaceTerm for DetachedColorLoss {
    fn evaluate(&self, hit: &SurfaceHit, gradient: &mut SurfaceGradient) -> f64 {
        let residual = hit.color.color - hit.pixel.color;
        gradient.grad_color += self.weight as f32 * residual.signum();
        f64::from(residual.abs().element_sum())
    }
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::super::term::gpu::{PixelRay, SurfaceGradient, SurfaceHit};
    use super::DetachedColorLoss;

    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Weights {
        pub weight: f32,
    }

    impl DetachedColorLoss {
        pub(crate) fn launch(&self) -> WeightsLaunch {
            WeightsLaunch { weight: self.weight as f32 }
        }
    }

    #[cube]
    pub(crate) fn evaluate(weights: &Weights, pixel: &PixelRay, hit: &SurfaceHit, gradient: &SurfaceGradient) -> f32 {
        let residual = hit.color.minus(&pixel.color);
        gradient.add_color(&residual.signs().times(weights.weight));
        residual.size()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::term::tests::{evaluated, pixel};
    use super::*;

    #[test]
    fn it_is_the_sum_of_absolute_differences_and_moves_colours_alone() {
        let (value, by_depth, by_color) = evaluated(&DetachedColorLoss { weight: 3.0 }, &pixel(f32::NAN));
        assert!((value - (0.1 + 0.4 + 0.6)).abs() < 1e-6, "{value}");
        assert_eq!((by_depth, by_color), (0.0, Vec3::new(-3.0, 3.0, -3.0)));
    }
}
