//! The colour classifier: which pixels that a mask says to be of one kind are, by their colours, of the other.

use std::collections::BTreeSet;

use glam::Vec3;

use super::regions::REACH;
use crate::flood::flood;

/// Colours of the claimed kind that are compared, at most.
const COLORS: usize = 1024;

/// How much nearer a pixel's colour must be to the other kind's than to the claimed one's, of 255.
const NEARER: f32 = 16.0;

/// Pixels from which a region counts however thin it is.
const LONG: usize = 12;

/// The share of an outline that must show background before any of it is taken away, and of a hole that must show the
/// object before any of it is given back.
pub(super) const MOST: f64 = 0.75;

/// How far, in pixels, a pixel that is mixed by its mask may be from one that is not and looks like the other kind, to be
/// of the other kind too: as wide as masks are soft.
const SOFT: usize = 2;

/// Two kinds of pixels, object and background, in either role: candidates that are claimed to be of one kind are compared
/// with the other kind around them. Pixels are indices, row by row.
pub(super) struct ColorClassifier<'a> {
    size: [usize; 2],
    /// Which pixels are of the other kind, that the candidates may be of, too.
    pub(super) known: &'a [bool],
    /// Which pixels the mask says to be partly object, partly background.
    mixed: &'a [bool],
    colors: &'a [[u8; 3]],
    /// Colours of the kind that candidates are claimed to be of.
    claimed: Vec<Vec3>,
    /// Pixels in question, in order.
    pub(super) candidates: Vec<usize>,
    /// Those of them that the other kind encloses.
    holes: Vec<Vec<usize>>,
}

impl<'a> ColorClassifier<'a> {
    /// Candidates are the `near` pixels that are not `known`; the claimed kind's colours are those of all pixels that are
    /// not `near`. `None` where there are no candidates, or nothing to compare them with.
    pub(super) fn new(
        size: [usize; 2],
        known: &'a [bool],
        mixed: &'a [bool],
        near: Vec<bool>,
        colors: &'a [[u8; 3]],
    ) -> Option<Self> {
        let beyond: Vec<usize> = (0..known.len()).filter(|&pixel| !near[pixel]).collect();
        let found: BTreeSet<[u8; 3]> = spread(&beyond, 4 * COLORS).map(|&pixel| colors[pixel]).collect();
        let found: Vec<[u8; 3]> = found.into_iter().collect();
        let claimed: Vec<Vec3> = spread(&found, COLORS).map(|color| Vec3::from(color.map(f32::from))).collect();
        let candidates: Vec<usize> = (0..known.len()).filter(|&pixel| near[pixel] && !known[pixel]).collect();
        let has_both = !claimed.is_empty() && !candidates.is_empty();
        has_both.then_some(Self { size, known, mixed, colors, claimed, candidates, holes: Vec::new() })
    }

    /// With regions of candidates that count as a whole or not at all.
    pub(super) fn with_holes(self, holes: Vec<Vec<usize>>) -> Self {
        Self { holes, ..self }
    }

    /// The candidates that are certainly of the other kind.
    pub(super) fn certain_pixels(&self) -> Vec<usize> {
        self.regions().into_iter().filter(|region| self.is_certain(region)).flatten().collect()
    }

    /// The square of four pixels that begins with one, where there is room for it.
    fn square(&self, pixel: usize) -> Option<[usize; 4]> {
        let [width, height] = self.size;
        let is_within = pixel % width + 1 < width && pixel / width + 1 < height;
        is_within.then_some([pixel, pixel + 1, pixel + width, pixel + width + 1])
    }

    fn color(&self, pixel: usize) -> Vec3 {
        Vec3::from(self.colors[pixel].map(f32::from))
    }

    /// The pixels of a square around one.
    pub(super) fn around(&self, pixel: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
        let [width, height] = self.size;
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(reach)..=(y + reach).min(height - 1);
        rows.flat_map(move |y| (x.saturating_sub(reach)..=(x + reach).min(width - 1)).map(move |x| y * width + x))
    }

    /// Whether a candidate looks like those of the other kind near it; `apart` is how far those are from the
    /// claimed colours.
    fn looks_known(&self, pixel: usize, apart: &mut [f32]) -> bool {
        let color = self.color(pixel);
        let from_claimed = nearest(color, &self.claimed);
        if from_claimed <= NEARER {
            return false;
        }
        let (mut from_known, mut contrast) = (f32::INFINITY, Vec::new());
        for near in self.around(pixel, REACH).filter(|&near| self.known[near]) {
            if apart[near].is_nan() {
                apart[near] = nearest(self.color(near), &self.claimed);
            }
            contrast.push(apart[near]);
            from_known = from_known.min(color.distance(self.color(near)));
        }
        contrast.sort_by(f32::total_cmp);
        let Some(median) = contrast.get(contrast.len() / 2) else { return false };
        from_claimed > 0.5 * median && from_claimed > from_known + NEARER
    }

    /// Takes back the looks of mixed pixels that no pixel beside them supports which is not mixed and looks the same.
    ///
    /// A mask that says of a pixel that it is mixed, at a soft edge, is right whatever the pixel's colour: straight alpha
    /// shows the object's colour alone there.
    fn believe_mixed(&self, looks: &mut [bool]) {
        let is_supported = |pixel: usize| self.around(pixel, SOFT).any(|near| looks[near] && !self.mixed[near]);
        let is_unsupported = |&pixel: &usize| looks[pixel] && self.mixed[pixel] && !is_supported(pixel);
        let unsupported: Vec<usize> = self.candidates.iter().copied().filter(is_unsupported).collect();
        unsupported.into_iter().for_each(|pixel| looks[pixel] = false);
    }

    /// Regions of candidates that look like the other kind, connected by edges or corners.
    fn regions(&self) -> Vec<Vec<usize>> {
        let mut apart = vec![f32::NAN; self.known.len()];
        let mut looks = vec![false; self.known.len()];
        for &pixel in &self.candidates {
            looks[pixel] = self.looks_known(pixel, &mut apart);
        }
        self.believe_mixed(&mut looks);
        // Of a hole that is dark in its middle, a shaded place or a true hole, the edges decide nothing.
        for hole in &self.holes {
            if (hole.iter().filter(|&&pixel| looks[pixel]).count() as f64) < MOST * hole.len() as f64 {
                hole.iter().for_each(|&pixel| looks[pixel] = false);
            }
        }
        let mut regions = Vec::new();
        for &start in &self.candidates {
            if looks[start] {
                let mut region = flood(start, &mut looks, |pixel| self.around(pixel, 1));
                region.sort_unstable();
                regions.push(region);
            }
        }
        regions
    }

    /// Whether a region is more than some pixels on the outline that may be mixed of both: it is long, or thicker than a
    /// pixel somewhere, or enclosed by the other kind.
    fn is_certain(&self, region: &[usize]) -> bool {
        let has = |pixel: usize| region.binary_search(&pixel).is_ok();
        let is_square = |&pixel: &usize| self.square(pixel).is_some_and(|square| square.into_iter().all(has));
        let is_enclosed = || {
            let mut around = region.iter().flat_map(|&pixel| self.around(pixel, 1));
            around.all(|pixel| self.known[pixel] || has(pixel))
        };
        region.len() >= LONG || region.iter().any(is_square) || is_enclosed()
    }
}

/// At most `most` of them, evenly spread.
fn spread<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    let count = all.len().min(most);
    (0..count).map(move |i| &all[i * all.len() / count])
}

/// Distance of a colour to the nearest of `among`.
fn nearest(color: Vec3, among: &[Vec3]) -> f32 {
    among.iter().map(|other| color.distance_squared(*other)).fold(f32::INFINITY, f32::min).sqrt()
}
