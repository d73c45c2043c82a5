//! How a photograph was exposed, beside the others of its scene.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::scene::Scene;

/// Above its first few levels, sRGB is `(1 + TOE) * light^(1 / EXPONENT) - TOE` (IEC 61966-2-1): a factor of the light
/// is a factor of `colour + TOE`.
const TOE: f32 = 0.055;
const EXPONENT: f32 = 2.4;

/// Levels of a channel, in `[0, 1]`, between which it is neither dark, where noise and rounding are large, nor burnt.
const USABLE: RangeInclusive<f32> = 10.0 / 255.0..=249.0 / 255.0;

/// Pixels of a photograph that must tell its exposure: fewer are not believed.
const FEWEST: usize = 30;

/// What takes the colours of a photograph to the mean exposure and white balance of its scene: a factor of the light of
/// each channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Exposure {
    /// Factors of `sRGB + TOE`.
    factors: [f32; 3],
}

impl Default for Exposure {
    fn default() -> Self {
        Self { factors: [1.0; 3] }
    }
}

impl Exposure {
    /// From logarithms of the factors, as [`Exposure::log`] makes them of colours.
    pub fn from_logs(logs: [f64; 3]) -> Self {
        Self { factors: logs.map(|log| log.exp() as f32) }
    }

    /// The logarithms of the factors.
    pub fn logs(self) -> [f64; 3] {
        self.factors.map(|factor| f64::from(factor).ln())
    }

    /// Whether a channel says something of the exposure: it is neither dark nor burnt.
    pub fn is_usable(channel: f32) -> bool {
        USABLE.contains(&channel)
    }

    /// The exposure of a photograph, channel by channel the median over pixels: what it shows, and what is there at the
    /// mean exposure. None where too few pixels tell.
    pub fn between(pixels: &[([f32; 3], [f32; 3])]) -> Self {
        let of_channel = |channel: usize| {
            let both = pixels.iter().map(|(shown, there)| (shown[channel], there[channel]));
            let usable = both.filter(|&(shown, there)| Self::is_usable(shown) && Self::is_usable(there));
            let mut logs: Vec<f64> = usable.map(|(shown, there)| Self::log(there) - Self::log(shown)).collect();
            logs.sort_by(f64::total_cmp);
            if logs.len() < FEWEST { 0.0 } else { logs[logs.len() / 2] }
        };
        Self::from_logs([0, 1, 2].map(of_channel))
    }

    /// Whether a pixel of a view that is not trained on tells the view's exposure. The others are compared at it: a
    /// checkerboard of blocks of 4x4, so that neighbours that are nearly the same fall into one half.
    pub fn is_told_by(u: u32, v: u32) -> bool {
        (u / 4 + v / 4).is_multiple_of(2)
    }

    /// The number of a channel's sRGB in `[0, 1]` to which a factor of the light is something added.
    pub fn log(channel: f32) -> f64 {
        f64::from(channel + TOE).ln()
    }

    /// What the logarithm of a factor is in stops of light.
    pub fn stops(log: f64) -> f64 {
        log * f64::from(EXPONENT) / std::f64::consts::LN_2
    }

    /// What the colours are multiplied by.
    #[inline]
    pub fn scale(self) -> Vec3 {
        Vec3::from(self.factors)
    }

    /// What is added to them then: exactly zero where nothing is corrected.
    #[inline]
    pub fn offset(self) -> Vec3 {
        (self.scale() - 1.0) * TOE
    }

    /// A colour at the mean exposure: sRGB, which may leave `[0, 1]`. The same bits where nothing is corrected.
    #[inline]
    pub fn corrected(self, color: Vec3) -> Vec3 {
        self.scale() * color + self.offset()
    }

    /// The colour that the photograph shows, in `[0, 1]`, of one at the mean exposure.
    pub fn photographed(self, color: [f32; 3]) -> [f32; 3] {
        ((Vec3::from(color) - self.offset()) / self.scale()).clamp(Vec3::ZERO, Vec3::ONE).to_array()
    }

    /// Puts the exposures that a run found, by name, into its scene: without any, all views are as they are.
    pub fn apply(found: &BTreeMap<String, Self>, scene: &mut Scene) {
        for view in &mut scene.views {
            view.exposure = if found.is_empty() { Some(Self::default()) } else { found.get(&view.name).copied() };
        }
    }

    /// The darkest and the brightest of photographs, in stops of light from their mean; `None` of none.
    pub fn range<'a>(found: impl IntoIterator<Item = &'a Self>) -> Option<[f64; 2]> {
        let stops = |exposure: &Self| -Self::stops(exposure.logs().iter().sum::<f64>() / 3.0);
        let both = |[a, b]: [f64; 2], [c, d]: [f64; 2]| [a.min(c), b.max(d)];
        found.into_iter().map(stops).map(|stops| [stops; 2]).reduce(both)
    }

    /// Whether the factors are numbers above zero.
    pub fn is_sound(self) -> bool {
        self.factors.iter().all(|factor| factor.is_finite() && *factor > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::srgb::{linear_to_srgb, srgb_to_linear};

    #[test]
    fn a_factor_of_the_light_is_found_and_undone_and_none_changes_no_bit() {
        let there = [0.2f32, 0.5, 0.7];
        let stops = [0.5, -0.7, 0.2];
        let shown = [0, 1, 2].map(|c| linear_to_srgb(srgb_to_linear(there[c]) * (stops[c] as f32).exp2()));
        let found = Exposure::between(&vec![(shown, there); 40]);
        for (log, stops) in found.logs().into_iter().zip(stops) {
            assert!((Exposure::stops(log) + stops).abs() < 1e-3, "{log}");
        }
        assert!((found.corrected(shown.into()) - Vec3::from(there)).length() < 1e-4);
        assert!((Vec3::from(found.photographed(there)) - Vec3::from(shown)).length() < 1e-4);
        assert_eq!(Exposure::between(&[(shown, there)]), Exposure::default(), "one pixel tells nothing");
        let color = Vec3::new(0.123_456, 0.0, 1.0);
        assert_eq!(
            Exposure::default().corrected(color).to_array().map(f32::to_bits),
            color.to_array().map(f32::to_bits)
        );
    }
}
