//! Tests of the depth's gradient where it is hardest: grazing rays, scaled fields, small batches.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Radius of the ball that rays hit. Its field is `radius - |p|`.
const RADIUS: f64 = 0.4;

/// Number of batches over which the spread is computed.
const BATCHES: usize = 400;

/// A test of the gradient of the depth by the ball's radius.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GradientTest {
    /// Its relative error against central differences, at an angle in degrees between ray and surface.
    Grazing,
    /// The same at 30 degrees, for a field that is multiplied by a factor.
    Scale,
    /// Relative standard deviation of its mean over a batch of this many rays, which are uniform on the ball's disc.
    Spread,
}

impl GradientTest {
    /// Largest figure that counts as solved.
    pub const LIMIT: f64 = 0.1;

    /// The figure at a difficulty. `rule` computes a finite `1/s` from the slope `s = g . w` and from `|g| |w|`.
    pub fn figure(self, rule: &dyn Fn(f32, f32) -> f32, difficulty: f64, seed: u64) -> f64 {
        match self {
            Self::Grazing => relative_error(rule, difficulty.to_radians().sin(), 1.0),
            Self::Scale => relative_error(rule, 0.5, difficulty),
            Self::Spread => spread(rule, difficulty as usize, seed),
        }
    }
}

/// The derivative of the depth by the ball's radius under a rule, at a cosine between ray and inward normal, for a field
/// times `scale`.
fn gradient(rule: &dyn Fn(f32, f32) -> f32, cosine: f64, scale: f64) -> f64 {
    // dd = -df / s with df = scale * dR: more radius, less depth.
    -scale * f64::from(rule((scale * cosine) as f32, scale as f32))
}

fn relative_error(rule: &dyn Fn(f32, f32) -> f32, cosine: f64, scale: f64) -> f64 {
    let impact = RADIUS * (1.0 - cosine * cosine).sqrt();
    // Small beside what is left between the ray and the silhouette.
    let step = 1e-4 * (RADIUS - impact);
    let difference = (depth(RADIUS + step, impact) - depth(RADIUS - step, impact)) / (2.0 * step);
    (gradient(rule, cosine, scale) / difference - 1.0).abs()
}

/// Where a ray along z first meets the ball, by bisection from one unit away to the ray's middle.
fn depth(radius: f64, impact: f64) -> f64 {
    let (mut outside, mut inside) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (outside + inside);
        let from_middle: f64 = 1.0 - middle;
        // The sign of radius - |p| without the root's rounding.
        if from_middle * from_middle > (radius - impact) * (radius + impact) {
            outside = middle;
        } else {
            inside = middle;
        }
    }
    0.5 * (outside + inside)
}

fn spread(rule: &dyn Fn(f32, f32) -> f32, rays: usize, seed: u64) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut ray = || {
        // Even on the disc that the camera sees: the square of the distance to its middle is uniform.
        let inside: f64 = rng.random();
        gradient(rule, (1.0 - inside).sqrt(), 1.0)
    };
    let means: Vec<f64> = (0..BATCHES).map(|_| (0..rays).map(|_| ray()).sum::<f64>() / rays as f64).collect();
    let mean = means.iter().sum::<f64>() / BATCHES as f64;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / BATCHES as f64;
    variance.sqrt() / mean.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The implicit function theorem as it is.
    fn exact(slope: f32, _: f32) -> f32 {
        slope.recip()
    }

    fn clamped(slope: f32, _: f32) -> f32 {
        slope.max(1e-3).recip()
    }

    #[test]
    fn the_implicit_function_theorem_agrees_with_differences_down_to_grazing_rays() {
        for degrees in [60.0, 5.0, 0.5, 0.05, 0.02] {
            let error = GradientTest::Grazing.figure(&exact, degrees, 0);
            assert!(error < 1e-3, "{degrees}: {error}");
        }
        assert!(GradientTest::Scale.figure(&exact, 1e-4, 0) < 1e-3);
    }

    #[test]
    fn a_clamp_is_wrong_at_grazing_rays_and_at_small_fields() {
        assert!(GradientTest::Grazing.figure(&clamped, 0.5, 0) < 1e-3);
        assert!(GradientTest::Grazing.figure(&clamped, 0.02, 0) > 0.5);
        assert!(GradientTest::Scale.figure(&clamped, 1e-4, 0) > 0.9);
    }

    #[test]
    fn larger_batches_spread_less() {
        let spread = |rays| GradientTest::Spread.figure(&clamped, rays, 1);
        assert!(spread(1024.0) < 0.5 * spread(64.0));
        assert_eq!(spread(64.0), spread(64.0));
    }
}
