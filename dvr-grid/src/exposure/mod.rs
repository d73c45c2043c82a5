//! Light that changes from photograph to photograph: the exposure and the white balance of each, from the surface.
//!
//! Where photographs differ by a factor of the light, views do not agree on the colour of any point, and raw colours can
//! say nothing of the surface. So the factors are solved for from points of the present surface that several views see,
//! and colours are read at the mean exposure from then on. Whether there are such factors is checked: those of one half
//! of the surface must make the views agree on the other. What shines does not pass: a highlight is bright in one place,
//! a factor everywhere.

mod least_squares;
mod samples;

use dvr_core::Exposure;

use crate::bricks::BrickValues;
use crate::config::GridConfig;
use crate::pixel_order::PixelOrder;
use crate::views::TrainingView;
use least_squares::{Ratio, gains, residual};
use samples::{Sample, samples};

/// The step, besides the first of each stage, before which exposures are solved for: the first surface may be a hull.
pub(crate) const EARLY: usize = 100;

/// The share of the difference between views that factors of the light must take away on points that did not tell them,
/// to be believed. Renders of bronze and plastic at constant light reach .02, photographs of a bronze head .05; DTU's
/// skull, which shadows and highlights cross as the camera moves, .17, and is no better with such factors; exposures that
/// differ by a third of a stop, .6 to .8.
const MIN_SHARE: f64 = 0.3;

/// And the same in standard errors.
const MIN_ERRORS: f64 = 4.0;

/// With fewer samples than this, or fewer blocks of the surface, nothing is known.
const FEWEST: usize = 200;
const FEWEST_BLOCKS: usize = 8;

/// Differences larger than this, as logarithms, are of occlusion or highlights, and count as this.
const LIMIT: f64 = 0.3;

/// How much factors of the light explain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Check {
    /// Mean difference of views at points that did not tell the factors, without and with them.
    pub without: f64,
    pub with: f64,
    /// Standard error of their difference, by blocks of the surface.
    pub error: f64,
}

impl Check {
    /// Whether factors of the light are what views differ by.
    pub fn is_passed(&self) -> bool {
        let gain = self.without - self.with;
        gain > MIN_SHARE * self.without && gain > MIN_ERRORS * self.error
    }
}

/// The exposures of views, and how they were checked.
#[derive(Clone, Debug)]
pub(crate) struct Solved {
    pub exposures: Vec<Exposure>,
    pub check: Check,
}

impl Solved {
    /// For people.
    pub fn note(&self) -> String {
        let [low, high] = Exposure::range(&self.exposures).unwrap_or_default();
        let Check { without, with, .. } = self.check;
        format!(
            "the photographs differ in exposure, from {low:+.2} to {high:+.2} stops of their mean: corrected, channel by \
             channel ({:.0} % of the difference between views is explained)",
            100.0 * (1.0 - with / without)
        )
    }
}

/// From the present surface, with the pixels that come after `rays_drawn`; `None` where factors of the light are not what views
/// differ by, or they hardly see the same.
pub(crate) fn solve(
    shape: &BrickValues<1>,
    views: &[TrainingView],
    order: &PixelOrder,
    config: &GridConfig,
    rays_drawn: u64,
) -> Option<Solved> {
    let samples = samples(shape, views, order, config, rays_drawn);
    let check = check(&samples, views.len()).filter(Check::is_passed)?;
    let logs = [0, 1, 2].map(|channel| gains(&ratios(&samples, channel, |_| true), views.len()));
    let of_view = |view: usize| Exposure::from_logs([0, 1, 2].map(|channel| logs[channel][view]));
    Some(Solved { exposures: (0..views.len()).map(of_view).collect(), check })
}

/// What samples say of a channel, those of which `is_asked` is true.
fn ratios(samples: &[Sample], channel: usize, is_asked: impl Fn(&Sample) -> bool) -> Vec<Ratio> {
    let asked = samples.iter().filter(|sample| sample.logs[channel].is_finite() && is_asked(sample));
    asked.map(|sample| Ratio { views: sample.views, log: sample.logs[channel] }).collect()
}

/// Solves on each half of the surface, and scores on the other.
fn check(samples: &[Sample], views: usize) -> Option<Check> {
    if samples.len() < FEWEST {
        return None;
    }
    let mut blocks = std::collections::BTreeMap::<u64, [f64; 3]>::new();
    for half in 0..2 {
        for channel in 0..3 {
            let gains = gains(&ratios(samples, channel, |sample| sample.block % 2 != half), views);
            for sample in samples.iter().filter(|sample| sample.block % 2 == half) {
                let ratio = Ratio { views: sample.views, log: sample.logs[channel] };
                if ratio.log.is_finite() {
                    let sums = blocks.entry(sample.block).or_default();
                    let scores = [ratio.log, residual(&ratio, &gains)].map(|log| log.abs().min(LIMIT));
                    *sums = [sums[0] + scores[0], sums[1] + scores[1], sums[2] + 1.0];
                }
            }
        }
    }
    if blocks.len() < FEWEST_BLOCKS {
        return None;
    }
    let [without, with, count] = blocks.values().fold([0.0; 3], |sum, block| [0, 1, 2].map(|i| sum[i] + block[i]));
    let (without, with) = (without / count, with / count);
    let off = |block: &[f64; 3]| block[0] - block[1] - (without - with) * block[2];
    let error = blocks.values().map(|block| off(block).powi(2)).sum::<f64>().sqrt() / count;
    Some(Check { without, with, error })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel_order::mix;

    /// Twelve views of a surface of 60 blocks, whose colours differ by what `brighter` says for block, view and channel,
    /// and by a little noise.
    fn seen(brighter: impl Fn(u64, u32, usize) -> f64) -> Vec<Sample> {
        let noise = |seed: u64| 0.02 * (mix(seed) as f64 / u64::MAX as f64 * 2.0 - 1.0);
        let sample = |i: u64| {
            let (block, first) = (mix(i % 60), (mix(i) % 12) as u32);
            let second = (first + 1 + (i % 3) as u32) % 12;
            let log = |c: usize| brighter(block, second, c) - brighter(block, first, c) + noise(3 * i + c as u64);
            Sample { views: [first, second], block, logs: [0, 1, 2].map(log) }
        };
        (0..6000).map(sample).collect()
    }

    #[test]
    fn factors_of_the_light_pass_and_constant_light_and_highlights_do_not() {
        let passes = |samples: &[Sample]| check(samples, 12).unwrap().is_passed();
        let jitter = |seed: u64| 0.15 * (mix(seed) as f64 / u64::MAX as f64 * 2.0 - 1.0);
        assert!(passes(&seen(|_, view, _| jitter(view.into()))), "exposure");
        assert!(passes(&seen(|_, view, channel| jitter(u64::from(view) * 3 + channel as u64))), "white balance");
        assert!(!passes(&seen(|_, _, _| 0.0)), "constant light");
        assert!(!passes(&seen(|block, view, _| jitter(block ^ u64::from(view)))), "highlights");
        assert_eq!(check(&seen(|_, _, _| 0.0)[..100], 12), None, "too little is seen");
    }
}
