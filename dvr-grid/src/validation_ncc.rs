//! The NCC of validation photographs with training photographs through the surface: what judges its shape during a run.
//!
//! PSNR is no such judge: where colour cannot depend on the view, dents explain highlights, and the worse shape gives the
//! better picture. So textured pixels of validation photographs are carried by the surface into neighbouring
//! *training photographs*, never into renders, and the patches compared there by normalised cross-correlation, as
//! stereo does to score its own depths. The pixels are chosen once, by the photographs alone. A pixel that meets no
//! surface, or whose point nothing else sees, counts as not alike at all. PSNR counts where this sees no difference
//! between stages; on what shines neither takes one back.

use dvr_core::View;
use rayon::prelude::*;

use crate::bricks::BrickOccupancy;
use crate::multires::Grids;
use crate::plane_patch::PlanePatch;
use crate::surface::Surface;
use crate::views::TrainingView;

/// Pixels that are scored, at most, of all validation photographs together.
const PIXELS: usize = 24_000;

/// With fewer, nothing is scored: the photographs are plain.
const FEWEST: usize = 100;

/// Variance of a patch's brightness, beyond that of a ramp, from which on it is textured: a contrast of .014, above the
/// noise of photographs.
const TEXTURED: f32 = 2e-4;

/// Training photographs that a pixel is carried to: those whose line of sight is nearest to this angle from its own,
/// radians. From nearer by, a wrong depth hardly shows.
const NEIGHBOURS: usize = 6;
const ANGLE: f32 = 0.4;

/// Photographs that should see a pixel's point: fewer are filled up with such as are not alike at all.
const FEWEST_SEEING: usize = 2;

/// How much of a correlation may be missing until a patch counts half: low, so that depths are told apart that are both
/// nearly right.
const HALF: f32 = 0.1;

/// Pixels of validation photographs, by which surfaces are compared.
pub(crate) struct ValidationNcc<'a> {
    views: Vec<TrainingView<'a>>,
    training: Vec<TrainingView<'a>>,
    /// View, column and row.
    pixels: Vec<(usize, [u32; 2])>,
}

/// How alike photographs are through a surface, pixel by pixel, in `[0, 1]`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NccScores(Vec<f32>);

/// How much better one surface is than another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gain {
    pub mean: f64,
    /// Standard error of the mean, by pixels that are taken for independent.
    pub error: f64,
}

impl<'a> ValidationNcc<'a> {
    /// Of training photographs that are shrunk by `factor`, as validation photographs are then. `None` where the validation photographs have too little texture, or there are none.
    pub fn new(validation: &[&'a View], factor: u32, training: Vec<TrainingView<'a>>) -> Option<Self> {
        let views: Vec<TrainingView> =
            validation.iter().map(|view| TrainingView::beside(view, factor, &training, NEIGHBOURS, ANGLE)).collect();
        let textured: Vec<(usize, [u32; 2])> = (views.par_iter().enumerate())
            .flat_map_iter(|(index, view)| {
                let [width, height] = view.size();
                let is_textured = move |[u, v]: [u32; 2]| PlanePatch::contrast(view, [u, v]) > TEXTURED;
                let pixels = (0..height).flat_map(move |v| (0..width).map(move |u| [u, v]));
                pixels.filter(move |&pixel| is_textured(pixel)).map(move |pixel| (index, pixel))
            })
            .collect();
        // Odd, so that it does not fall on one column.
        let stride = textured.len().div_ceil(PIXELS).max(1) | 1;
        let pixels: Vec<_> = textured.into_iter().step_by(stride).collect();
        (pixels.len() >= FEWEST).then_some(Self { views, training, pixels })
    }

    /// The scores of a surface.
    pub fn scores(&self, grids: &Grids) -> NccScores {
        let occupancy = BrickOccupancy::new(grids.shape.values());
        let surface = Surface::of(grids.shape.values(), &occupancy);
        let pixels = self.pixels.par_iter();
        NccScores(pixels.map(|&(view, pixel)| score(&surface, &self.views[view], pixel, &self.training)).collect())
    }
}

/// How alike a pixel's surroundings are in the photographs that see its point.
fn score(surface: &Surface, view: &TrainingView, [u, v]: [u32; 2], training: &[TrainingView]) -> f32 {
    let Some(at) = surface.hit(view, view.direction(u, v)) else { return 0.0 };
    let Some(patch) = PlanePatch::on_plane(view, [u, v], 1, view.camera.center, at.point, at.inward) else {
        return 0.0;
    };
    let seen = (view.neighbours.iter().map(|&other| &training[other as usize]))
        .filter_map(|other| patch.compare(other).filter(|_| surface.is_seen_by(&at, other)));
    let (sum, count) = seen.fold((0.0, 0), |(sum, count), found| {
        (sum + 1.0 / (1.0 + (1.0 - found.correlation.max(0.0)) / HALF), count + 1)
    });
    sum / count.max(FEWEST_SEEING) as f32
}

impl NccScores {
    /// Of all pixels.
    pub fn mean(&self) -> f64 {
        self.0.iter().map(|&score| f64::from(score)).sum::<f64>() / self.0.len() as f64
    }

    /// How much better this is than `other`, pixel by pixel.
    pub fn gain_over(&self, other: &Self) -> Gain {
        let gains = self.0.iter().zip(&other.0).map(|(new, old)| f64::from(new - old));
        let count = self.0.len() as f64;
        let (sum, squares) = gains.fold((0.0, 0.0), |(sum, squares), gain| (sum + gain, squares + gain * gain));
        let mean = sum / count;
        Gain { mean, error: ((squares / count - mean * mean).max(0.0) / count).sqrt() }
    }
}

impl std::fmt::Display for Gain {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{:+.4} +- {:.4} of NCC score", self.mean, self.error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    /// What the first photograph of a speckled ball of radius .3 says of a ball of another radius, with the others to
    /// compare with.
    fn scored(radius: f32) -> NccScores {
        let fixture = Fixture::speckled_ball(radius, GridLosses::default());
        let training = TrainingView::pack(&fixture.pictures[1..], 2, 1);
        let ncc = ValidationNcc::new(&fixture.pictures[..1], 1, training).expect("speckles are textured");
        ncc.scores(&fixture.grids)
    }

    #[test]
    fn the_true_surface_is_liked_best_and_by_more_than_noise() {
        let truth = scored(0.3);
        assert!(truth.mean() > 0.5, "{}", truth.mean());
        for radius in [0.28, 0.295, 0.305, 0.32] {
            let Gain { mean, error } = truth.gain_over(&scored(radius));
            assert!(mean > 5.0 * error && error > 0.0, "{radius}: {mean} +- {error}");
        }
    }

    #[test]
    fn a_missing_surface_is_not_alike_at_all() {
        let small = scored(0.1);
        let missed = small.0.iter().filter(|&&score| score == 0.0).count();
        assert!(2 * missed > small.0.len(), "{missed} of {}", small.0.len());
    }

    #[test]
    fn ramps_of_brightness_do_not_judge() {
        let fixture = Fixture::ball(0.3, GridLosses::default());
        assert!(ValidationNcc::new(&fixture.pictures[..1], 1, fixture.views[1..].to_vec()).is_none());
        assert!(ValidationNcc::new(&[], 1, fixture.views).is_none());
    }
}
