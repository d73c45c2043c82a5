//! How far colours may shape the surface: as far as the views agree on them.
//!
//! Terms that compare raw colours take a point's colour for the same from everywhere. On a render of constant light that
//! holds to a hundredth; on a photograph of something shiny, or of changing exposure, it is off by a tenth and more, and
//! such terms dent the surface until it explains highlights. So the difference of colour between views is measured on
//! the surface itself: the share of hits where others agree with the pixel says how far raw colours count. What they
//! lose goes to the patch NCC, which is blind to exposure, and to smoothness. Where still fewer agree, the object shines,
//! and the patch NCC leaves out its highlights.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use crate::bricks::{BrickOccupancy, BrickValues};
use crate::config::GridConfig;
use crate::losses::GridLosses;
use crate::pixel_order::PixelOrder;
use crate::step::draw::{DrawnRay, compared, draw};
use crate::surface::Surface;
use crate::views::{PixelRay, TrainingView};

/// Pixels that a measurement asks.
const PIXELS: u64 = 4096;

/// How many times as many a measurement asks that counts a part of the surface only.
const PARTS: u64 = 8;

/// With fewer answers than this, nothing is known: all is outline, as of what is a pixel or two thin.
const FEWEST: usize = 100;

/// Steps from measurement to measurement.
pub(crate) const EVERY: usize = 50;

/// Pixels to all sides of one among which views may show a colour: while the surface is still learned, texture is a
/// pixel or more from where it should be, and that is no change of light.
pub(crate) const AROUND: u32 = 1;

/// Mean gap between the ranges of colours, summed over three channels in `[0, 1]`, up to which views agree with a pixel.
const AGREES: f32 = 0.005;

/// Share of hits with agreement up to which colours count for nothing, and from which they count in full. Renders of
/// constant light reach .93 to 1 while their surface is still learned, bronze and plastic .3, photographs of DTU and Middlebury .55
/// to .75.
const SHARES: [f64; 2] = [0.75, 0.9];

/// Share of hits with agreement from which highlights pull as anything else, and up to which they do not pull.
const SHARES_OF_SHINE: [f64; 2] = [0.55, 0.4];

/// The weight of the patch NCC where raw colours count for nothing, as a factor.
const PATCH_NCC: f64 = 4.0;

/// The same for the scale of its robust function: what shines is never quite alike, and must not pull.
const PATCH_SCALE: f64 = 0.1;

/// The same for smoothness.
const SMOOTHNESS: f64 = 3.0;

/// The share of hits where other views agree with the colour of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Agreement(pub f64);

impl Agreement {
    /// Nothing speaks against raw colours.
    pub const FULL: Self = Self(1.0);

    /// How far raw colours count, in `[0, 1]`.
    pub fn trust(self) -> f64 {
        self.between(SHARES)
    }

    /// How far patches lose their pull where they are highlights, in `[0, 1]`.
    pub fn shine(self) -> f64 {
        self.between(SHARES_OF_SHINE)
    }

    /// By how far views differ at the hits of pixels; in full where there is little to compare.
    pub fn of(differences: impl Iterator<Item = f32>) -> Self {
        let found: Vec<f32> = differences.collect();
        if found.len() < FEWEST {
            return Self::FULL;
        }
        let agreeing = found.iter().filter(|&&difference| difference < AGREES).count();
        Self(agreeing as f64 / found.len() as f64)
    }

    fn between(self, [from, to]: [f64; 2]) -> f64 {
        ((self.0 - from) / (to - from)).clamp(0.0, 1.0)
    }
}

/// How far views agree: by the pixels that come after `rays_drawn`.
pub(crate) fn agreement(
    shape: &BrickValues<1>,
    views: &[TrainingView],
    order: &PixelOrder,
    config: &GridConfig,
    rays_drawn: u64,
) -> Agreement {
    let found = differences(shape, views, order, config, asked(rays_drawn));
    Agreement::of(found.into_iter().map(|(_, difference)| difference))
}

/// The rays that a measurement asks.
pub(crate) fn asked(rays_drawn: u64) -> Range<u64> {
    rays_drawn..rays_drawn + PIXELS
}

/// The mean difference in colour between views, summed over the channels, of the points of a surface that `is_asked` says, and
/// of the others; `None` where there is little to compare.
pub(crate) fn differences_by(
    shape: &BrickValues<1>,
    views: &[TrainingView],
    order: &PixelOrder,
    config: &GridConfig,
    is_asked: impl Fn(Vec3) -> bool,
) -> [Option<f32>; 2] {
    let found = differences(shape, views, order, config, 0..PARTS * PIXELS);
    let (asked, others): (Vec<_>, Vec<_>) = found.into_iter().partition(|(point, _)| is_asked(*point));
    [asked, others].map(|part| {
        let sum: f32 = part.iter().map(|(_, difference)| difference).sum();
        (part.len() >= FEWEST).then(|| sum / part.len() as f32)
    })
}

/// Points where the rays with these numbers meet a surface, with how far the colours of other views differ there.
fn differences(
    shape: &BrickValues<1>,
    views: &[TrainingView],
    order: &PixelOrder,
    config: &GridConfig,
    rays: Range<u64>,
) -> Vec<(Vec3, f32)> {
    let occupancy = BrickOccupancy::new(shape);
    let surface = Surface::of(shape, &occupancy);
    let ask = |ray: u64| {
        let DrawnRay { view, pixel, seed } = draw(order, config.seed, ray);
        let own = &views[view as usize];
        let pixel = own.pixel_ray(view, pixel);
        let others = compared(&own.neighbours, config.compared_views, seed).map(|other| &views[other as usize]);
        // Pixels at the outline are part background.
        if own.is_interior(pixel.pixel) { color_difference(&surface, own, &pixel, others) } else { None }
    };
    rays.into_par_iter().filter_map(ask).collect()
}

/// How far other views differ in colour from a pixel at its hit, summed over the channels: their mean. Compared are
/// ranges of colours around the pixels, which does not see what is misplaced by a pixel (after Birchfield and Tomasi
/// 1998). With the hit itself; `None` where nothing is hit or none sees it.
fn color_difference<'a>(
    surface: &Surface,
    own: &TrainingView,
    pixel: &PixelRay,
    others: impl Iterator<Item = &'a TrainingView<'a>>,
) -> Option<(Vec3, f32)> {
    let at = surface.hit(own, pixel.direction)?;
    let [low, high] = own.color_range(pixel.pixel, AROUND)?;
    let gap = |[least, greatest]: [Vec3; 2]| (low - greatest).max(least - high).max(Vec3::ZERO).element_sum();
    let seen = others
        .filter_map(|view| view.color_range_at(at.point, AROUND).filter(|_| surface.is_seen_by(&at, view)).map(gap));
    let (sum, count) = seen.fold((0.0, 0), |(sum, count), gap| (sum + gap, count + 1));
    (count > 0).then(|| (at.point, sum / count as f32))
}

impl GridLosses {
    /// The weights where views agree as far as this.
    pub(crate) fn trusting_colors(&self, agreement: Agreement) -> Self {
        let trust = agreement.trust();
        let doubt = 1.0 - trust;
        let mut losses = self.clone();
        // What a colour no longer says of the surface, it still says of the colour.
        losses.detached_color.weight += doubt * losses.color.weight;
        losses.color.weight *= trust;
        losses.photo_consistency.weight *= trust;
        losses.patch_ncc.weight *= 1.0 + doubt * (PATCH_NCC - 1.0);
        losses.patch_ncc.scale *= 1.0 + doubt * (PATCH_SCALE - 1.0);
        losses.patch_ncc.highlights = losses.patch_ncc.highlights.max(agreement.shine());
        losses.smoothness.weight *= 1.0 + doubt * (SMOOTHNESS - 1.0);
        losses
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::Exposure;

    use super::*;
    use crate::step::suite::Fixture;

    #[test]
    fn texture_that_is_a_pixel_off_is_trusted_and_light_that_changes_is_not() {
        // Speckles on a ball that is a little too small.
        let mut fixture = Fixture::speckled_ball(0.29, GridLosses::default());
        let trust = |fixture: &Fixture| {
            agreement(fixture.grids.shape.values(), &fixture.views, &fixture.order, &fixture.config, fixture.rays_drawn)
                .trust()
        };
        let constant = trust(&fixture);
        assert!(constant > 0.9, "{constant}");
        fixture.views[1].exposure = Exposure::from_logs([0.3; 3]);
        let changed = trust(&fixture);
        assert!(changed < 0.1, "{changed}");
    }

    #[test]
    fn views_differ_in_colour_where_the_surface_is_not_and_only_what_is_asked_counts() {
        // Speckles on a ball of radius .3, and a surface like that of a hull that closes a mouth.
        let difference = |radius: f32, is_asked: fn(Vec3) -> bool| {
            let Fixture { grids, views, order, config, .. } = Fixture::speckled_ball(radius, GridLosses::default());
            differences_by(grids.shape.values(), &views, &order, &config, is_asked)
        };
        let [right, wrong] = [0.3, 0.4].map(|radius| difference(radius, |at| at.x > 0.0).map(Option::unwrap));
        assert!(right[0] < 0.1 * wrong[0] && right[1] < 0.1 * wrong[1], "{right:?} {wrong:?}");
        let [none, all] = difference(0.4, |at| at.x > 10.0);
        assert!(none.is_none() && all.is_some());
    }

    #[test]
    fn what_colours_lose_goes_to_patches_and_smoothness_and_the_colour_is_still_learned() {
        let losses = GridLosses::default();
        assert_eq!(losses.trusting_colors(Agreement::FULL), losses);
        let doubted = losses.trusting_colors(Agreement(0.0));
        assert_eq!((doubted.color.weight, doubted.photo_consistency.weight), (0.0, 0.0));
        assert_eq!(doubted.detached_color.weight, losses.color.weight);
        assert!(doubted.patch_ncc.weight > losses.patch_ncc.weight);
        assert!(doubted.smoothness.weight > losses.smoothness.weight);
        assert_eq!(doubted.patch_ncc.highlights, 1.0);
    }

    #[test]
    fn highlights_pull_until_still_fewer_agree_than_raw_colours_need() {
        let losses = GridLosses::default();
        for (share, highlights) in [(0.75, 0.0), (0.55, 0.0), (0.475, 0.5), (0.4, 1.0), (0.2, 1.0)] {
            let found = losses.trusting_colors(Agreement(share));
            assert_eq!(found.color.weight, 0.0);
            assert!((found.patch_ncc.highlights - highlights).abs() < 1e-9, "{found:?}");
        }
        // Whoever asks for it has it everywhere.
        let mut asked = GridLosses::default();
        asked.patch_ncc.highlights = 0.7;
        assert_eq!(asked.trusting_colors(Agreement::FULL).patch_ncc.highlights, 0.7);
    }
}
