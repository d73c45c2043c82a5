//! What the photograph knows better than its mask: holes, bites, outlines drawn too tight or too wide.
//!
//! Programs that make masks leave holes in them. One hole in one of many views carves a tunnel through the visual hull.
//! What a mask leaves out shows the object's colours in the photograph and not the background's, wherever these can be
//! told apart.

use std::collections::BTreeSet;

use glam::Vec3;

use crate::scene::View;

/// How far from the outline, in pixels, a mask may be wrong; what is farther away teaches the colours of its kind.
const REACH: usize = 6;

/// Colours of the background that are compared, at most.
const COLORS: usize = 1024;

/// Coverage from which a pixel is the object's: see [`crate::Mask::is_object`].
const OBJECT: u8 = 128;

/// How much nearer a pixel's colour must be to the object's than to the background's, of 255.
const NEARER: f32 = 16.0;

/// Pixels from which a piece is mended however thin it is.
const LONG: usize = 12;

/// The share of an outline that must show background before any of it is taken away, and of a hole that must show the
/// object before any of it is given back.
const MOST: f64 = 0.75;

/// Holes larger than this share of the object are left alone.
const LARGEST: f64 = 0.25;

/// What a photograph says of its mask.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Mended {
    /// How many pixels were given back to the object.
    pub given_back: usize,
    /// Pixels along the outline that show background, row by row: see [`take_rims`].
    pub rim: Vec<usize>,
}

/// Gives a view's mask back what it leaves out of the object, and looks for a rim of background.
///
/// Looked at is background near the object, and what the object closes in. A pixel is the object's where its colour is
/// nearer to that of the object around it than to any of the background's, and more than half as far from these as
/// the object is there. Some pixels in a row on the outline decide nothing: they may be mixed of both. Where the
/// photograph is itself cut out, what is missing shows the background's colour, and stays.
///
/// The other way round, a rim shows the background around it and no colour of the object's inside, along most of the
/// outline: a highlight is no background.
pub(super) fn mend_mask(view: &mut View) -> Mended {
    let (width, height) = view.mask.size();
    let size = [width as usize, height as usize];
    let colors = view.image.as_raw().as_chunks().0;
    let mut object: Vec<bool> = view.mask.coverage.iter().map(|&coverage| coverage >= OBJECT).collect();

    let given_back = Doubt::of_background(size, &object, colors).map_or_else(Vec::new, |doubt| doubt.certain_pixels());
    given_back.iter().for_each(|&pixel| object[pixel] = true);
    let background: Vec<bool> = object.iter().map(|&is_object| !is_object).collect();
    let rim = Doubt::of_rim(size, &background, colors).map_or_else(Vec::new, |doubt| {
        let rim = doubt.certain_pixels();
        if doubt.is_most_of_the_outline(&rim) { rim } else { Vec::new() }
    });

    let coverage: &mut [u8] = &mut view.mask.coverage;
    given_back.iter().for_each(|&pixel| coverage[pixel] = u8::MAX);
    Mended { given_back: given_back.len(), rim }
}

/// Takes the rims away that were found in so many of the views, if that is half of them or more: what makes masks too
/// wide does so everywhere, and in single views the object's edges may look like the background. Whether it did.
pub(super) fn take_rims(views: &mut [(View, Mended)], looked_at: usize) -> bool {
    let found = views.iter().filter(|(_, mended)| !mended.rim.is_empty()).count();
    if found == 0 || 2 * found < looked_at {
        return false;
    }
    for (view, mended) in views.iter_mut().filter(|(_, mended)| !mended.rim.is_empty()) {
        let coverage: &mut [u8] = &mut view.mask.coverage;
        mended.rim.iter().for_each(|&pixel| coverage[pixel] = 0);
    }
    true
}

/// What is asked of a photograph, by the places of pixels, row by row: which of the pixels that are said to be of one
/// kind are of the other.
struct Doubt<'a> {
    size: [usize; 2],
    /// Which pixels are of the kind that the doubtful ones may be of, too.
    known: &'a [bool],
    colors: &'a [[u8; 3]],
    /// Colours of the kind that they are said to be of.
    claimed: Vec<Vec3>,
    /// Pixels in doubt, in order.
    doubtful: Vec<usize>,
    /// Those of them that the other kind closes in.
    holes: Vec<Vec<usize>>,
}

impl<'a> Doubt<'a> {
    /// Background that may be object. `None` where there is none, or nothing to compare it with.
    fn of_background(size: [usize; 2], object: &'a [bool], colors: &'a [[u8; 3]]) -> Option<Self> {
        let most = (LARGEST * object.iter().filter(|&&is_object| is_object).count() as f64) as usize;
        let mut closed = object.to_vec();
        let mut holes = holes(object, size);
        holes.retain(|hole| hole.len() <= most);
        holes.iter().flatten().for_each(|&pixel| closed[pixel] = true);
        Some(Self { holes, ..Self::new(size, object, near(&closed, size), colors)? })
    }

    /// Object near its outline that may be background. `None` where there is none, or nothing farther inside.
    fn of_rim(size: [usize; 2], background: &'a [bool], colors: &'a [[u8; 3]]) -> Option<Self> {
        Self::new(size, background, near(background, size), colors)
    }

    fn new(size: [usize; 2], known: &'a [bool], near: Vec<bool>, colors: &'a [[u8; 3]]) -> Option<Self> {
        let beyond: Vec<usize> = (0..known.len()).filter(|&pixel| !near[pixel]).collect();
        let found: BTreeSet<[u8; 3]> = spread(&beyond, 4 * COLORS).map(|&pixel| colors[pixel]).collect();
        let found: Vec<[u8; 3]> = found.into_iter().collect();
        let claimed: Vec<Vec3> = spread(&found, COLORS).map(|color| Vec3::from(color.map(f32::from))).collect();
        let doubtful: Vec<usize> = (0..known.len()).filter(|&pixel| near[pixel] && !known[pixel]).collect();
        let has_both = !claimed.is_empty() && !doubtful.is_empty();
        has_both.then_some(Self { size, known, colors, claimed, doubtful, holes: Vec::new() })
    }

    /// The doubtful pixels that are certainly of the other kind.
    fn certain_pixels(&self) -> Vec<usize> {
        self.pieces().into_iter().filter(|piece| self.is_certain(piece)).flatten().collect()
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
    fn around(&self, pixel: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
        let [width, height] = self.size;
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(reach)..=(y + reach).min(height - 1);
        rows.flat_map(move |y| (x.saturating_sub(reach)..=(x + reach).min(width - 1)).map(move |x| y * width + x))
    }

    /// Whether a doubtful pixel looks like those of the other kind near it; `apart` is how far those are from the
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

    /// Pieces of doubtful pixels that look like the other kind, and hang together by edges or corners.
    fn pieces(&self) -> Vec<Vec<usize>> {
        let mut apart = vec![f32::NAN; self.known.len()];
        let mut looks = vec![false; self.known.len()];
        for &pixel in &self.doubtful {
            looks[pixel] = self.looks_known(pixel, &mut apart);
        }
        // Of a hole that is dark in its middle, a shaded place or a true hole, the edges tell nothing.
        for hole in &self.holes {
            if (hole.iter().filter(|&&pixel| looks[pixel]).count() as f64) < MOST * hole.len() as f64 {
                hole.iter().for_each(|&pixel| looks[pixel] = false);
            }
        }
        let mut pieces = Vec::new();
        for &start in &self.doubtful {
            if looks[start] {
                let mut piece = flood(start, &mut looks, |pixel| self.around(pixel, 1));
                piece.sort_unstable();
                pieces.push(piece);
            }
        }
        pieces
    }

    /// Whether a piece is more than some pixels on the outline that may be mixed of both: it is long, or thicker than a
    /// pixel somewhere, or closed in by the other kind.
    fn is_certain(&self, piece: &[usize]) -> bool {
        let has = |pixel: usize| piece.binary_search(&pixel).is_ok();
        let is_square = |&pixel: &usize| self.square(pixel).is_some_and(|square| square.into_iter().all(has));
        let is_closed_in = || {
            let mut around = piece.iter().flat_map(|&pixel| self.around(pixel, 1));
            around.all(|pixel| self.known[pixel] || has(pixel))
        };
        piece.len() >= LONG || piece.iter().any(is_square) || is_closed_in()
    }

    /// Whether most of the doubtful pixels that touch the other kind are among some.
    fn is_most_of_the_outline(&self, pixels: &[usize]) -> bool {
        let mut chosen = vec![false; self.known.len()];
        pixels.iter().for_each(|&pixel| chosen[pixel] = true);
        let touches = |&&pixel: &&usize| self.around(pixel, 1).any(|near| self.known[near]);
        let outline: Vec<usize> = self.doubtful.iter().filter(touches).copied().collect();
        let found = outline.iter().filter(|&&pixel| chosen[pixel]).count();
        found as f64 > MOST * outline.len() as f64
    }
}

/// Takes out of `left` what hangs together with a pixel of it by `beside`: its places.
fn flood<I: Iterator<Item = usize>>(start: usize, left: &mut [bool], beside: impl Fn(usize) -> I) -> Vec<usize> {
    left[start] = false;
    let (mut piece, mut next) = (vec![start], 0);
    while let Some(&pixel) = piece.get(next) {
        next += 1;
        piece.extend(beside(pixel).filter(|&pixel| std::mem::take(&mut left[pixel])));
    }
    piece
}

/// Pieces of what is not set that do not reach the frame, as their pixels; they hang together by edges.
fn holes(set: &[bool], [width, height]: [usize; 2]) -> Vec<Vec<usize>> {
    let mut left: Vec<bool> = set.iter().map(|&is_set| !is_set).collect();
    let on_frame = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        x == 0 || y == 0 || x + 1 == width || y + 1 == height
    };
    let beside = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let left = (x > 0).then(|| pixel - 1);
        let right = (x + 1 < width).then_some(pixel + 1);
        let above = (y > 0).then(|| pixel - width);
        let below = (y + 1 < height).then_some(pixel + width);
        [left, right, above, below].into_iter().flatten()
    };
    // What reaches the frame goes first: what is left is closed in.
    for start in (0..set.len()).filter(|&pixel| on_frame(pixel)) {
        if left[start] {
            flood(start, &mut left, beside);
        }
    }
    let mut holes = Vec::new();
    for start in 0..set.len() {
        if left[start] {
            holes.push(flood(start, &mut left, beside));
        }
    }
    holes
}

/// What lies in a square of `REACH` around something that is set. (Exact distances, `distance_transform::signed_distance`, take
/// longer than all else here.)
fn near(set: &[bool], [width, height]: [usize; 2]) -> Vec<bool> {
    // Along rows, then along columns.
    let mut along_rows = vec![false; set.len()];
    for (row, out) in set.chunks(width).zip(along_rows.chunks_mut(width)) {
        for x in (0..width).filter(|&x| row[x]) {
            // What the pixel before has set need not be set again.
            let from = if x > 0 && row[x - 1] { (x + REACH).min(width - 1) } else { x.saturating_sub(REACH) };
            out[from..(x + REACH + 1).min(width)].fill(true);
        }
    }
    let mut near = vec![false; set.len()];
    for y in 0..height {
        for other in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            let row = &along_rows[other * width..][..width];
            near[y * width..][..width].iter_mut().zip(row).for_each(|(near, &other)| *near |= other);
        }
    }
    near
}

/// So many of them at most, evenly spread.
fn spread<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    let count = all.len().min(most);
    (0..count).map(move |i| &all[i * all.len() / count])
}

/// Distance of a colour to the nearest of some.
fn nearest(color: Vec3, among: &[Vec3]) -> f32 {
    among.iter().map(|other| color.distance_squared(*other)).fold(f32::INFINITY, f32::min).sqrt()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::{GrayImage, Luma, Rgb, RgbImage};

    use super::*;
    use crate::camera::Camera;
    use crate::pixels::stored;
    use crate::raster::Mask;
    use crate::scene::Split;

    const SIZE: u32 = 60;

    const WHITE: Rgb<u8> = Rgb([255; 3]);

    fn square(u: u32, v: u32) -> bool {
        (10..50).contains(&u) && (10..50).contains(&v)
    }

    /// A patterned square of 40 pixels on a background. The mask leaves out what `missing` says; the picture is `shown`
    /// there, where that is given.
    fn view(missing: impl Fn(u32, u32) -> bool, shown: Option<Rgb<u8>>, background: Rgb<u8>) -> View {
        let image = RgbImage::from_fn(SIZE, SIZE, |u, v| match shown {
            Some(color) if missing(u, v) => color,
            _ if square(u, v) => Rgb([150 + (u * 7 + v * 3) as u8 % 60, 40 + (v * 5) as u8 % 40, 30]),
            _ => background,
        });
        let coverage = |u, v| Luma([if square(u, v) && !missing(u, v) { 255 } else { 0 }]);
        let camera = Camera::look_at(SIZE, SIZE, 60.0, DVec3::Z, DVec3::ZERO, DVec3::Y);
        let (image, mask) = (stored(image), Mask::from(GrayImage::from_fn(SIZE, SIZE, coverage)));
        View { name: "0".into(), camera, image, mask, depth: None, split: Split::Train }
    }

    /// A disc of 29 pixels.
    fn disc(u: u32, v: u32, (x, y): (u32, u32)) -> bool {
        u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2) <= 9
    }

    fn is_whole(view: &View) -> bool {
        (0..SIZE).all(|v| (0..SIZE).all(|u| view.mask.is_object(u, v) == square(u, v)))
    }

    #[test]
    fn what_shows_the_object_is_given_back() {
        let hole = |u: u32, v: u32| disc(u, v, (30, 25));
        let bite = |u: u32, v: u32| disc(u, v, (12, 25));
        let tight = |u: u32, v: u32| !((11..49).contains(&u) && (11..49).contains(&v));
        let loose = |u: u32, v: u32| !((14..46).contains(&u) && (14..46).contains(&v));
        let speck = |u: u32, v: u32| (u, v) == (30, 30);
        type Missing<'a> = &'a dyn Fn(u32, u32) -> bool;
        let missing: [(Missing, usize); 5] = [(&hole, 29), (&bite, 28), (&tight, 156), (&loose, 576), (&speck, 1)];
        for (i, (missing, count)) in missing.into_iter().enumerate() {
            let mut view = view(missing, None, WHITE);
            assert_eq!(mend_mask(&mut view), Mended { given_back: count, rim: Vec::new() }, "{i}");
            assert!(is_whole(&view), "{i}");
            assert_eq!(mend_mask(&mut view), Mended::default(), "{i}, again");
        }
    }

    #[test]
    fn what_shows_the_background_or_cannot_be_told_stays() {
        let hole = |u: u32, v: u32| disc(u, v, (30, 25));
        // A true hole; one with a shade of the background, as a shadow or an unsharp edge makes it; an object that looks like
        // its background.
        for (shown, background) in
            [(Some(WHITE), WHITE), (Some(Rgb([225, 200, 200])), WHITE), (None, Rgb([170, 60, 30]))]
        {
            assert_eq!(mend_mask(&mut view(hole, shown, background)), Mended::default(), "{shown:?} {background:?}");
        }
        // A hole that looks like the object at its edge alone.
        let mut shaded = view(hole, None, WHITE);
        (0..SIZE).flat_map(|u| (0..SIZE).map(move |v| (u, v))).filter(|&(u, v)| u > 28 && hole(u, v)).for_each(
            |(u, v)| {
                shaded.image.put_pixel(u, v, WHITE);
            },
        );
        assert_eq!(mend_mask(&mut shaded), Mended::default());
        // Some pixels on the outline, more of the object than of the background.
        let mixed = |u: u32, v: u32| u == 10 && (20..28).contains(&v);
        assert_eq!(mend_mask(&mut view(mixed, Some(Rgb([180, 110, 100])), WHITE)), Mended::default());
        // Most of the object, and all of it.
        let most = |u: u32, v: u32| (14..46).contains(&u) && (14..46).contains(&v);
        assert_eq!(mend_mask(&mut view(most, None, WHITE)), Mended::default());
        assert_eq!(mend_mask(&mut view(|_, _| true, None, WHITE)), Mended::default());
    }

    /// A view whose mask is so many pixels too wide.
    fn wide(rim: u32, background: Rgb<u8>) -> View {
        let mut view = view(|_, _| false, None, background);
        let reach = 10 - rim..50 + rim;
        let pixels = view.mask.coverage.enumerate_pixels_mut();
        pixels.filter(|(u, v, _)| reach.contains(u) && reach.contains(v)).for_each(|(_, _, pixel)| pixel.0[0] = 255);
        view
    }

    #[test]
    fn a_rim_of_background_is_found_where_it_goes_around() {
        for rim in [1, 2, 4] {
            let mended = mend_mask(&mut wide(rim, WHITE));
            assert_eq!((mended.given_back, mended.rim.len()), (0, ((40 + 2 * rim).pow(2) - 1600) as usize));
        }
        // White at one side of the object, on white.
        let mut highlight = view(|_, _| false, None, WHITE);
        for (u, v) in (20..40).flat_map(|u| (10..16).map(move |v| (u, v))) {
            highlight.image.put_pixel(u, v, WHITE);
        }
        assert_eq!(mend_mask(&mut highlight), Mended::default());
    }

    #[test]
    fn rims_are_taken_away_where_half_of_the_masks_have_one() {
        for (wide_ones, all, is_taken) in [(1, 3, false), (2, 3, true), (0, 3, false)] {
            let views = (0..all).map(|i| if i < wide_ones { wide(2, WHITE) } else { wide(0, WHITE) });
            let mut views: Vec<(View, Mended)> = views.map(|mut view| (view.clone(), mend_mask(&mut view))).collect();
            assert_eq!(take_rims(&mut views, all), is_taken);
            assert_eq!(
                views.iter().filter(|(view, _)| is_whole(view)).count(),
                if is_taken { all } else { all - wide_ones }
            );
        }
    }
}
