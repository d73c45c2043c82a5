//! Patch NCC: one less the normalised cross-correlation of a patch around the pixel with its projection to other views.
//!
//! `L = weight * mean_v rho(1 - NCC(P, P_v))` with `rho(e) = e / (1 + e / scale)` (Geman and McClure 1985, for an error
//! that is a square already): 5x5 samples around the pixel are carried by the tangent plane of the surface
//! at the hit to the other view, and their brightnesses compared (as in Geo-Neus, Fu et al. 2022, and PGSR, Chen et al.
//! 2024, with the plane's homography written as points on the plane). It is blind to exposure, and to what has no
//! texture. The gradient takes the plane's normal for fixed: the patch moves along the
//! pixel's ray, parallel to itself.
//!
//! A highlight is the mirror image of a light. It lies behind a convex surface, is alike in neighbouring views, and so
//! pulls a dent into what shines. It is brighter than the same place in the other view, and than the colour that all views
//! together gave the place: of a patch that is brighter than both by `b`, `highlights / (1 + (WIDTH / b)^2)` of its pull is
//! taken away. The value is not: it is that of all patches alike.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::term::{Comparison, CrossViewTerm, LossTerm, SurfaceHit};
use crate::plane_patch::PlanePatch;
use crate::views::TrainingView;

/// Most pixels between the samples of a patch.
const MAX_STRIDE: f64 = 64.0;

/// How much brighter a patch is that has lost half of its pull, where `highlights` is 1.
const HIGHLIGHT_WIDTH: f32 = 0.05;

/// One less the normalised cross-correlation of a patch around the pixel with its projection, by the plane of the
/// surface, to other views. Blind to exposure and to what has no texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PatchNccLoss {
    /// Weight of the mean over rays and the views they are compared with.
    pub weight: f64,
    /// Patches less correlated than this are taken for occlusion, and ignored.
    pub min_correlation: f64,
    /// How much of the correlation may be missing until a patch pulls a quarter as much: highlights and what is half
    /// hidden are never alike.
    pub scale: f64,
    /// Pixels between the samples of a patch of 5x5.
    pub stride: u32,
    /// How far patches lose their pull that are brighter than in the other view, and than the colour of the surface: 0
    /// not at all, 1 as far as they are highlights.
    pub highlights: f64,
}

impl Default for PatchNccLoss {
    fn default() -> Self {
        Self { weight: 1.0, min_correlation: 0.3, scale: 3.0, stride: 1, highlights: 0.0 }
    }
}

impl LossTerm for PatchNccLoss {
    fn weight(&self) -> f64 {
        self.weight
    }

    fn parameters(&self) -> Vec<(&'static str, f64, RangeInclusive<f64>)> {
        vec![
            ("min_correlation", self.min_correlation, -1.0..=1.0),
            ("scale", self.scale, 1e-6..=f64::MAX),
            ("stride", f64::from(self.stride), 1.0..=MAX_STRIDE),
            ("highlights", self.highlights, 0.0..=1.0),
        ]
    }

    #[cfg(test)]
    fn for_tests() -> Self {
        Self { weight: 1.0, min_correlation: -1.0, scale: 0.3, stride: 1, highlights: 0.0 }
    }

    /// The surface turns a little as the point moves on it; the gradient takes its plane for fixed.
    #[cfg(test)]
    fn slack() -> f64 {
        0.2
    }
}

impl CrossViewTerm for PatchNccLoss {
    type Prepared = PlanePatch;

    fn prepare(&self, own: &TrainingView, hit: &SurfaceHit) -> Option<PlanePatch> {
        PlanePatch::on_plane(own, hit.pixel.pixel, self.stride, hit.origin, hit.point, hit.inward)
    }

    fn compare(&self, patch: &PlanePatch, hit: &SurfaceHit, other: &Comparison, grad_depth: &mut f32) -> f64 {
        match patch.compare(other.view) {
            Some(found) if found.correlation > self.min_correlation as f32 => {
                let (value, slope) = robust(1.0 - found.correlation, self.scale as f32);
                let usual = hit.color.color.element_sum() / 3.0;
                let kept = kept_pull(patch.mean(), found.seen, usual, self.highlights as f32);
                *grad_depth -= self.weight as f32 * kept * slope * found.derivative;
                f64::from(value)
            }
            _ => 0.0,
        }
    }
}

/// `e / (1 + e / scale)` and its derivative: the less alike two patches are, the less they pull.
fn robust(error: f32, scale: f32) -> (f32, f32) {
    let damping = 1.0 / (1.0 + error / scale);
    (error * damping, damping * damping)
}

/// The share of its pull that a patch keeps, by how bright it is in its own view, in the other, and usually.
fn kept_pull(own: f32, seen: f32, usual: f32, highlights: f32) -> f32 {
    // One of the two views shows a highlight at most: the brighter one.
    let brighter = ((own - seen).abs()).min(own.max(seen) - usual).max(0.0) / HIGHLIGHT_WIDTH;
    1.0 - highlights * (1.0 - 1.0 / (1.0 + brighter * brighter))
}

/// The same inside kernels.
#[cfg(feature = "gpu")]
pub(crate) mod gpu {
    #![allow(missing_docs)]

    use cubecl::prelude::*;

    use super::super::term::gpu::{PixelRay, SurfaceHit};
    use super::{HIGHLIGHT_WIDTH, PatchNccLoss};
    use crate::gpu::views::{Photo, Seen, is_object};
    use crate::gpu::voxel::Point;
    use crate::plane_patch::{MAX_STRETCH, NOISE, REACH, SAMPLES, SIDE};

    #[derive(CubeLaunch, CubeType, Clone, Copy)]
    pub(crate) struct Weights {
        pub weight: f32,
        pub min_correlation: f32,
        pub scale: f32,
        pub stride: u32,
        pub highlights: f32,
    }

    impl PatchNccLoss {
        pub(crate) fn launch(&self) -> WeightsLaunch {
            WeightsLaunch {
                weight: self.weight as f32,
                min_correlation: self.min_correlation as f32,
                scale: self.scale as f32,
                stride: self.stride,
                highlights: self.highlights as f32,
            }
        }
    }

    /// Brightnesses around a pixel, on the plane that its ray meets.
    #[derive(CubeType)]
    pub(crate) struct Prepared {
        /// Whether the object and the plane can be seen in all samples.
        is_whole: bool,
        normal: Point,
        /// The plane's distance from the camera along its normal, and how fast the normal is approached on the middle
        /// ray.
        height: f32,
        slope: f32,
        /// Less their mean.
        brightness: Array<f32>,
        mean: f32,
        variance: f32,
        /// Brightness of the surface's colour.
        usual: f32,
    }

    #[cube]
    pub(crate) fn prepare(
        weights: &Weights,
        views: &[u32],
        pixels: &[u32],
        pixel: &PixelRay,
        hit: &SurfaceHit,
    ) -> Prepared {
        let (own, normal, stride) = (&pixel.view, &hit.inward, weights.stride);
        let height = normal.dot(&hit.point.minus(&pixel.origin));
        let slope = normal.dot(&pixel.direction);
        let depth = height / slope;
        let mut brightness = Array::<f32>::new(SAMPLES);
        let mut is_whole = weights.weight > 0.0f32;
        for i in 0..SAMPLES {
            let column = pixel.u + (i as u32 % SIDE as u32) * stride;
            let row = pixel.v + (i as u32 / SIDE as u32) * stride;
            let reach = REACH * stride;
            let within = column >= reach && row >= reach && column - reach < own.width && row - reach < own.height;
            // Out of the frame, the pixel itself stands in.
            let x = select(within, column - reach, pixel.u);
            let y = select(within, row - reach, pixel.v);
            let shown = pixels[own.index(x, y)];
            brightness[i] = own.color(views, shown).sum() / 3.0f32;
            let stretch = height / normal.dot(&own.direction(views, x, y)) / depth;
            let is_near = stretch < MAX_STRETCH && stretch * MAX_STRETCH > 1.0f32;
            is_whole = is_whole && within && is_object(shown) && is_near;
        }
        let mean = center(&mut brightness);
        let variance = variance(&brightness);
        let usual = hit.color.sum() / 3.0f32;
        Prepared { is_whole, normal: normal.copied(), height, slope, brightness, mean, variance, usual }
    }

    #[cube]
    pub(crate) fn compare(
        weights: &Weights,
        patch: &Prepared,
        views: &[u32],
        pixels: &[u32],
        pixel: &PixelRay,
        other: &Photo,
        _seen: &Seen,
        grad_depth: &RuntimeCell<f32>,
    ) -> f32 {
        let mut seen = Array::<f32>::new(SAMPLES);
        let mut moves = Array::<f32>::new(SAMPLES);
        let mut is_seen = patch.is_whole;
        if is_seen {
            for i in 0..SAMPLES {
                let column = pixel.u + (i as u32 % SIDE as u32) * weights.stride - REACH * weights.stride;
                let row = pixel.v + (i as u32 / SIDE as u32) * weights.stride - REACH * weights.stride;
                let direction = pixel.view.direction(views, column, row);
                let approach = patch.normal.dot(&direction);
                let point = pixel.origin.along(&direction, patch.height / approach);
                let at = other.reproject(views, pixels, &point, &direction.times(patch.slope / approach));
                seen[i] = at.color.sum() / 3.0f32;
                moves[i] = at.derivative.sum() / 3.0f32;
                is_seen = is_seen && at.is_object;
            }
        }
        let mut value = 0.0f32;
        if is_seen {
            let mean = center(&mut seen);
            let variance = variance(&seen);
            let mut likeness = 0.0f32;
            let mut own_moves = 0.0f32;
            let mut seen_moves = 0.0f32;
            for i in 0..SAMPLES {
                likeness += patch.brightness[i] * seen[i];
                own_moves += patch.brightness[i] * moves[i];
                seen_moves += seen[i] * moves[i];
            }
            let samples = comptime!(SAMPLES as f32);
            let scale = ((patch.variance + NOISE) * (variance + NOISE)).sqrt();
            let correlation = likeness / samples / scale;
            if correlation > weights.min_correlation {
                let derivative =
                    own_moves / samples / scale - correlation * (seen_moves / samples) / (variance + NOISE);
                let damping = 1.0f32 / (1.0f32 + (1.0f32 - correlation) / weights.scale);
                let kept = kept_pull(patch.mean, mean, patch.usual, weights.highlights);
                grad_depth.store(grad_depth.read() - weights.weight * kept * damping * damping * derivative);
                value = (1.0f32 - correlation) * damping;
            }
        }
        value
    }

    #[cube]
    fn kept_pull(own: f32, seen: f32, usual: f32, highlights: f32) -> f32 {
        let brighter = (own - seen).abs().min(own.max(seen) - usual).max(0.0f32) / HIGHLIGHT_WIDTH;
        1.0f32 - highlights * (1.0f32 - 1.0f32 / (1.0f32 + brighter * brighter))
    }

    /// Subtracts the mean and returns it.
    #[cube]
    fn center(values: &mut Array<f32>) -> f32 {
        let samples = comptime!(SAMPLES as f32);
        let mut sum = 0.0f32;
        for i in 0..SAMPLES {
            sum += values[i];
        }
        let mean = sum / samples;
        for i in 0..SAMPLES {
            values[i] -= mean;
        }
        mean
    }

    /// Of values whose mean is zero.
    #[cube]
    fn variance(values: &Array<f32>) -> f32 {
        let mut squares = 0.0f32;
        for i in 0..SAMPLES {
            squares += values[i] * values[i];
        }
        squares / comptime!(SAMPLES as f32)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::term::SurfaceHit;
    use super::*;
    use crate::color::ColorSample;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    #[test]
    fn patches_that_are_less_alike_pull_less() {
        assert_eq!(robust(0.0, 0.3), (0.0, 1.0));
        for (error, scale) in [(0.1f32, 0.3f32), (0.3, 0.3), (1.2, 0.3), (0.5, 3.0)] {
            let (value, slope) = robust(error, scale);
            let rho = |e: f64| e / (1.0 + e / f64::from(scale));
            let difference = (rho(f64::from(error) + 1e-4) - rho(f64::from(error) - 1e-4)) / 2e-4;
            assert!((f64::from(value) - rho(f64::from(error))).abs() < 1e-6, "{value}");
            assert!((f64::from(slope) - difference).abs() < 1e-5, "{slope}, not {difference}");
        }
    }

    #[test]
    fn the_brighter_of_two_patches_is_a_highlight_where_the_surface_is_darker_too() {
        // As far as it is brighter than the other view.
        for (brighter, kept) in [(0.0, 1.0), (HIGHLIGHT_WIDTH, 0.5), (3.0 * HIGHLIGHT_WIDTH, 0.1)] {
            for (own, seen) in [(0.4, 0.4 + brighter), (0.4 + brighter, 0.4)] {
                let found = kept_pull(own, seen, 0.3, 1.0);
                assert!((found - kept).abs() < 1e-5, "{found}, not {kept}");
                let half = kept_pull(own, seen, 0.3, 0.5);
                assert!((half - 0.5 - 0.5 * kept).abs() < 1e-5, "{half}");
                assert_eq!(kept_pull(own, seen, 0.3, 0.0), 1.0);
            }
        }
        // A surface as bright as the brighter view: the other shows a shadow, or is wrong.
        assert_eq!(kept_pull(0.8, 0.4, 0.8, 1.0), 1.0);
        assert_eq!(kept_pull(0.8, 0.4, 0.9, 1.0), 1.0);
    }

    #[test]
    fn patches_that_are_too_unlike_say_nothing_and_others_pull_by_their_weight() {
        let fixture = Fixture::speckled_ball(0.3, GridLosses::default());
        let (own, other) = (&fixture.views[0], &fixture.views[1]);
        let pixel = own.pixel_ray(0, 48 * 96 + 48);
        let hit = SurfaceHit {
            pixel: &pixel,
            origin: own.camera.center,
            depth: 1.31,
            point: own.camera.center + 1.31 * pixel.direction,
            inward: Vec3::new(0.35, -0.25, 0.9),
            color: ColorSample { color: Vec3::ZERO, derivative: Vec3::ZERO },
        };
        let patch = PlanePatch::on_plane(own, [48, 48], 1, hit.origin, hit.point, hit.inward).unwrap();
        let found = patch.compare(other).unwrap();
        let seen = other.reproject(hit.point, pixel.direction).unwrap();
        let pulled = |min_correlation: f64| {
            let loss = PatchNccLoss { weight: 3.0, min_correlation, scale: 0.3, stride: 1, highlights: 0.0 };
            let mut gradient = 5.0;
            let value = loss.compare(&patch, &hit, &Comparison { view: other, seen }, &mut gradient);
            (value, gradient - 5.0)
        };
        let (value, slope) = robust(1.0 - found.correlation, 0.3);
        let (found_value, gradient) = pulled(f64::from(found.correlation) - 0.01);
        assert!((found_value - f64::from(value)).abs() < 1e-6, "{found_value}");
        let expected = -3.0 * slope * found.derivative;
        assert!((gradient - expected).abs() < 1e-3 * expected.abs() && expected != 0.0, "{gradient}, not {expected}");
        assert_eq!(pulled(f64::from(found.correlation) + 0.01), (0.0, 0.0));
    }
}
