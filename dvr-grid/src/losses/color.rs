//! Colour: the field's colour where a ray meets the surface against its pixel, in L1.
//!
//! `L = weight * |c(p(d)) - c_pixel|_1`, with `p(d)` the point at ray depth `d`. The gradient by the colour is the sign
//! of the residual; by the depth it is the sign times the derivative of the colour along the ray, which moves the
//! surface (Niemeyer et al. 2020; the step multiplies it by the implicit gradient of the depth).

use serde::{Deserialize, Serialize};

use super::term::{LossTerm, SurfaceGradient, SurfaceHit, SurfaceTerm};

/// Colour of hits against their pixels, L1. Its gradient shapes the surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ColorLoss {
    /// Weight of the mean over rays.
    pub weight: f64,
}

impl Default for ColorLoss {
    fn default() -> Self {
        Self { weight: 1.0 }
    }
}

impl LossTerm for ColorLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        Self { weight: 1.0 }
    }
}

impl SurfaceTerm for ColorLoss {
    fn evaluate(&self, hit: &SurfaceHit, gradient: &mut SurfaceGradient) -> f64 {
        let residual = hit.color.color - hit.pixel.color;
        let (weight, sign) = (self.weight as f32, residual.signum());
        gradient.grad_depth += weight * sign.dot(hit.color.derivative);
        gradient.grad_color += weight * sign;
        f64::from(residual.abs().element_sum())
    }
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::super::term::gpu::{PixelRay, SurfaceGradient, SurfaceHit};
    use super::ColorLoss;

    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Weights {
        pub weight: f32,
    }

    impl ColorLoss {
        pub(crate) fn launch(&self) -> WeightsLaunch {
            WeightsLaunch { weight: self.weight as f32 }
        }
    }

    #[cube]
    pub(crate) fn evaluate(weights: &Weights, pixel: &PixelRay, hit: &SurfaceHit, gradient: &SurfaceGradient) -> f32 {
        let residual = hit.color.minus(&pixel.color);
        let sign = residual.signs();
        gradient.add_depth(weights.weight * sign.dot(&hit.color_derivative));
        gradient.add_color(&sign.times(weights.weight));
        residual.size()
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::term::tests::{evaluated, pixel};
    use super::*;

    #[test]
    fn it_is_the_sum_of_absolute_differences_and_its_gradient_is_weighted() {
        let (value, by_depth, by_color) = evaluated(&ColorLoss { weight: 3.0 }, &pixel(f32::NAN));
        assert!((value - (0.1 + 0.4 + 0.6)).abs() < 1e-6, "{value}");
        assert_eq!(by_color, Vec3::new(-3.0, 3.0, -3.0));
        assert_eq!(by_depth, 3.0 * (-1.0 + 10.0 - 100.0));
    }
}
