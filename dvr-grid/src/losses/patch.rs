//! Small pieces of surface compared between photographs by their structure, whatever the exposure.

use crate::constants::{self, MAX_STRETCH, PATCH_NOISE};
use glam::Vec3;

use crate::views::TrainingView;

/// Samples of a patch: along its side, and all.
const SIDE: usize = constants::PATCH_SIDE;
const SAMPLES: usize = SIDE * SIDE;

/// Brightnesses around a pixel, and the points of the surface's tangent plane that they are seen at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    points: [Vec3; SAMPLES],
    /// How they move on their rays as the plane moves along the middle one.
    motions: [Vec3; SAMPLES],
    /// Less their mean.
    brightness: [f32; SAMPLES],
    variance: f32,
}

/// How alike two patches are, and how that changes as the surface moves along the ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Likeness {
    /// Normalised cross-correlation, in `[-1, 1]`.
    pub correlation: f32,
    pub derivative: f32,
}

impl Patch {
    /// The patch around `pixel` of `view`, whose camera is at `origin`, on the plane through `point` with this normal
    /// (of either sign); `None` at the object's outline and where the plane is seen edge-on.
    pub fn on_plane(
        view: &TrainingView,
        [u, v]: [u32; 2],
        stride: u32,
        origin: Vec3,
        point: Vec3,
        normal: Vec3,
    ) -> Option<Self> {
        let (mut points, mut motions, mut brightness) = ([Vec3::ZERO; SAMPLES], [Vec3::ZERO; SAMPLES], [0.0; SAMPLES]);
        let height = normal.dot(point - origin);
        let slope = normal.dot(view.direction(u, v));
        let depth = height / slope;
        for i in 0..SAMPLES {
            let (du, dv) = ((i % SIDE) as u32 * stride, (i / SIDE) as u32 * stride);
            let (u, v) = ((u + du).checked_sub(stride)?, (v + dv).checked_sub(stride)?);
            brightness[i] = view.brightness(u, v)?;
            let direction = view.direction(u, v);
            let ray_depth = height / normal.dot(direction);
            let stretch = ray_depth / depth;
            if !(stretch < MAX_STRETCH && stretch * MAX_STRETCH > 1.0) {
                return None;
            }
            points[i] = origin + ray_depth * direction;
            motions[i] = slope / normal.dot(direction) * direction;
        }
        let variance = center(&mut brightness);
        Some(Self { points, motions, brightness, variance })
    }

    /// Compares with what another view shows at the same points; `None` where it does not show all of them.
    pub fn compare(&self, view: &TrainingView) -> Option<Likeness> {
        let (mut seen, mut moves) = ([0.0; SAMPLES], [0.0; SAMPLES]);
        for i in 0..SAMPLES {
            let at = view.reproject(self.points[i], self.motions[i])?;
            seen[i] = at.color.element_sum() / 3.0;
            moves[i] = at.derivative.element_sum() / 3.0;
        }
        let variance = center(&mut seen);
        // With centred values, derivatives need not be centred: their mean falls out of the sums.
        let mean =
            |a: &[f32; SAMPLES], b: &[f32; SAMPLES]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>() / SAMPLES as f32;
        let scale = ((self.variance + PATCH_NOISE) * (variance + PATCH_NOISE)).sqrt();
        let correlation = mean(&self.brightness, &seen) / scale;
        let derivative =
            mean(&self.brightness, &moves) / scale - correlation * mean(&seen, &moves) / (variance + PATCH_NOISE);
        Some(Likeness { correlation, derivative })
    }
}

/// Subtracts the mean; returns the variance.
fn center(values: &mut [f32; SAMPLES]) -> f32 {
    let mean = values.iter().sum::<f32>() / SAMPLES as f32;
    values.iter_mut().for_each(|value| *value -= mean);
    values.iter().map(|value| value * value).sum::<f32>() / SAMPLES as f32
}
