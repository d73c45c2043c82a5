//! How deep pixels see, by comparing photographs on planes before each camera (plane sweeping: Collins 1996).
//!
//! Neighbouring pictures are warped to each plane as a whole and compared in windows by box sums, so that it takes
//! seconds. What matters here is not how exact a depth is but that it is right: a depth is kept where one plane
//! matches far better than all others, and where two neighbours see the same place at their own depths.

use dvr_core::{Cancellation, Cancelled};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::shrunk::Shrunk;

/// Planes before a camera, evenly spaced in inverse depth.
const PLANES: usize = 64;

/// Bytes of a pixel while its view is swept: the best two correlations on each plane.
pub(crate) const SWEPT_PIXEL: u64 = 8 * PLANES as u64;

/// Half the side of the windows that are compared, pixels.
const HALF: usize = 2;

/// The side of the windows, and their pixels.
const SIDE: usize = 2 * HALF + 1;
const COUNT: f32 = (SIDE * SIDE) as f32;

/// The grey value of what lies beyond the frame.
const UNKNOWN: f32 = -1e3;

/// Other views that a view is compared with.
const NEIGHBOURS: usize = 4;

/// Best angle between a view and its neighbours, degrees; and the least and greatest.
const ANGLES: [f32; 3] = [5.0, 12.0, 35.0];

/// Standard deviation of a window's grey values from which it shows something to compare.
const MIN_DEVIATION: f32 = 1.0;

/// Correlation from which two windows show the same.
const ALIKE: f32 = 0.6;

/// By how much the best plane must correlate better than all that are not beside it.
const LEAD: f32 = 0.05;

/// Planes to either side that count as beside one.
const BESIDE: usize = 3;

/// How far depths of two views may differ where they see the same place, in planes.
const AGREEING: f32 = 2.0;

/// Other views that must see the same place.
const CONFIRMING: usize = 2;

/// Depths of a view's pixels; no number where none is known.
pub(crate) type Depths = Vec<f32>;

/// How far from the origin depths are looked for, along what a camera sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    /// On the camera's side.
    pub before: f32,
    /// On the other.
    pub behind: f32,
}

/// Depths of all views within `reach` of the origin, by comparing each with views that are `asked`. `done` is called after
/// each view.
///
/// # Errors
/// [`Cancelled`] where somebody wants it to end.
pub(crate) fn depths(
    views: &[Shrunk],
    asked: &[bool],
    reach: Reach,
    cancellation: &Cancellation,
    done: &(dyn Fn() + Sync),
) -> Result<Vec<Depths>, Cancelled> {
    let grays: Vec<Vec<f32>> = views.iter().map(Shrunk::gray).collect();
    let sweep = Sweep { views, grays, reach, neighbours: neighbours(views, asked) };
    let of_view = |view| sweep.of_view(view, cancellation).inspect(|_| done());
    let found: Vec<Depths> = (0..views.len()).into_par_iter().map(of_view).collect::<Result<_, _>>()?;
    Ok((0..views.len()).into_par_iter().map(|view| sweep.confirmed(view, &found)).collect())
}

/// The `asked` views that each view is compared with: at a good angle, and on different sides.
fn neighbours(views: &[Shrunk], asked: &[bool]) -> Vec<Vec<usize>> {
    let directions: Vec<Vec3> = views.iter().map(|view| view.camera.center.normalize_or_zero()).collect();
    let of_view = |own: usize| {
        let angle = |other: usize| directions[own].angle_between(directions[other]).to_degrees();
        let mut others: Vec<(f32, usize)> = (0..views.len())
            .filter(|&other| other != own && asked[other] && (ANGLES[0]..ANGLES[2]).contains(&angle(other)))
            .map(|other| ((angle(other) / ANGLES[1]).ln().abs(), other))
            .collect();
        others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut chosen: Vec<usize> = Vec::new();
        // Those that look from almost the same side as one that is chosen add nothing: they come last.
        let is_new = |chosen: &[usize], other: usize| {
            chosen.iter().all(|&before| directions[before].angle_between(directions[other]).to_degrees() > ANGLES[0])
        };
        for pass in [true, false] {
            for &(_, other) in &others {
                if chosen.len() < NEIGHBOURS && !chosen.contains(&other) && (!pass || is_new(&chosen, other)) {
                    chosen.push(other);
                }
            }
        }
        chosen
    };
    (0..views.len()).map(of_view).collect()
}

struct Sweep<'a> {
    views: &'a [Shrunk],
    grays: Vec<Vec<f32>>,
    reach: Reach,
    neighbours: Vec<Vec<usize>>,
}

impl Sweep<'_> {
    /// Least and greatest inverse depth of a view's planes.
    fn range(&self, view: usize) -> [f32; 2] {
        let camera = &self.views[view].camera;
        let middle = camera.project(Vec3::ZERO).1;
        let near = (middle - self.reach.before).max(0.1 * self.reach.before);
        [1.0 / (middle + self.reach.behind).max(2.0 * near), 1.0 / near]
    }

    fn spacing(&self, view: usize) -> f32 {
        let [low, high] = self.range(view);
        (high - low) / (PLANES - 1) as f32
    }

    fn of_view(&self, own: usize, cancellation: &Cancellation) -> Result<Depths, Cancelled> {
        let view = &self.views[own];
        let pixels = view.len();
        let mut window = Windows::new(view.width, view.height);
        let gray = &self.grays[own];
        let [mean, deviation] = window.moments(gray);
        let [low, _] = self.range(own);
        let spacing = self.spacing(own);
        let mut scores = vec![[f32::NEG_INFINITY; 2]; PLANES * pixels];
        let mut warped = vec![0f32; pixels];
        for &other in &self.neighbours[own] {
            let warp = Warp::new(view, &self.views[other]);
            for plane in 0..PLANES {
                cancellation.check()?;
                warp.apply(
                    low + plane as f32 * spacing,
                    view.width,
                    &self.views[other],
                    &self.grays[other],
                    &mut warped,
                );
                let scores = &mut scores[plane * pixels..(plane + 1) * pixels];
                window.correlate(gray, &mean, &deviation, &warped, |pixel, score| {
                    let best = &mut scores[pixel];
                    if score > best[0] {
                        *best = [score, best[0]];
                    } else {
                        best[1] = best[1].max(score);
                    }
                });
            }
        }
        let depth = |pixel: usize| {
            if deviation[pixel] < MIN_DEVIATION {
                return f32::NAN;
            }
            let score = |plane: usize| {
                let [first, second] = scores[plane * pixels + pixel];
                0.5 * (first + second)
            };
            let best = (0..PLANES).max_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap_or(0);
            let rival =
                (0..PLANES).filter(|plane| plane.abs_diff(best) > BESIDE).map(score).fold(f32::NEG_INFINITY, f32::max);
            // The first and the last plane may be as near as it gets to something beyond.
            let is_inside = (1..PLANES - 1).contains(&best);
            if is_inside && score(best) > ALIKE && score(best) > rival + LEAD {
                let [before, middle, after] = [score(best - 1), score(best), score(best + 1)];
                let bend = (2.0 * middle - before - after).max(1e-6);
                let offset = (0.5 * (after - before) / bend).clamp(-0.5, 0.5);
                1.0 / (low + (best as f32 + if offset.is_finite() { offset } else { 0.0 }) * spacing)
            } else {
                f32::NAN
            }
        };
        Ok((0..pixels).map(depth).collect())
    }

    /// The depths of a view that other views confirm.
    fn confirmed(&self, own: usize, found: &[Depths]) -> Depths {
        let view = &self.views[own];
        let is_confirmed = |pixel: usize, depth: f32| {
            let point = view.camera.center + depth * view.camera.direction_through(view.middle(pixel));
            let agrees = |&&other: &&usize| {
                let picture = &self.views[other];
                let (place, z) = picture.camera.project(point);
                let seen = picture.pixel_at(place).filter(|_| z > 0.0).map(|pixel| found[other][pixel]);
                seen.is_some_and(|seen| (1.0 / seen - 1.0 / z).abs() < AGREEING * self.spacing(other))
            };
            self.neighbours[own].iter().filter(agrees).count() >= CONFIRMING
        };
        let depths = found[own].iter().enumerate();
        depths.map(|(pixel, &depth)| if is_confirmed(pixel, depth) { depth } else { f32::NAN }).collect()
    }
}

/// From pixels of one view on a plane before it to places in another.
struct Warp {
    /// For a pixel and 1, the place in the other view of what is infinitely far away, homogeneous.
    far: glam::Mat3,
    /// What an inverse depth of 1 adds.
    epipole: Vec3,
}

impl Warp {
    fn new(view: &Shrunk, other: &Shrunk) -> Self {
        Self {
            far: other.camera.projection * view.camera.to_direction,
            epipole: other.camera.projection * view.camera.center + other.camera.offset,
        }
    }

    /// The other picture on the plane of this inverse depth; no numbers beyond its frame.
    fn apply(&self, inverse: f32, width: usize, other: &Shrunk, source: &[f32], warped: &mut [f32]) {
        let step = self.far.x_axis;
        let limit = Vec2::new(other.width as f32 - 1.0, other.height as f32 - 1.0);
        for (v, row) in warped.chunks_mut(width).enumerate() {
            let mut at = self.far * Vec3::new(0.5, v as f32 + 0.5, 1.0) + inverse * self.epipole;
            for value in row {
                let place = Vec2::new(at.x, at.y) / at.z - 0.5;
                at += step;
                // What is not known is below all grey values.
                *value = if at.z > 0.0 && place.x >= 0.0 && place.y >= 0.0 && place.x < limit.x && place.y < limit.y {
                    let (x, y) = (place.x as usize, place.y as usize);
                    let [fx, fy] = [place.x - x as f32, place.y - y as f32];
                    let first = y * other.width + x;
                    let second = first + other.width;
                    let upper = source[first] + fx * (source[first + 1] - source[first]);
                    let lower = source[second] + fx * (source[second + 1] - source[second]);
                    upper + fy * (lower - upper)
                } else {
                    UNKNOWN
                };
            }
        }
    }
}

/// Sums over windows around the pixels of a picture.
struct Windows {
    width: usize,
    height: usize,
    /// Sums along a row of values, their squares, and their products with the other picture, for all rows.
    rows: [Vec<f32>; 3],
}

impl Windows {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, rows: [(); 3].map(|()| vec![0.0; width * height]) }
    }

    fn is_inside(&self, u: usize, v: usize) -> bool {
        u >= HALF && v >= HALF && u + HALF < self.width && v + HALF < self.height
    }

    /// Means and standard deviations; no deviation where a window leaves the picture.
    fn moments(&self, values: &[f32]) -> [Vec<f32>; 2] {
        let (mut means, mut deviations) = (vec![0.0; values.len()], vec![0.0; values.len()]);
        for pixel in 0..values.len() {
            let (u, v) = (pixel % self.width, pixel / self.width);
            if !self.is_inside(u, v) {
                continue;
            }
            let window = (0..SIDE * SIDE).map(|i| values[(v + i / SIDE - HALF) * self.width + u + i % SIDE - HALF]);
            let mean = window.clone().sum::<f32>() / COUNT;
            means[pixel] = mean;
            deviations[pixel] = (window.map(|value| (value - mean).powi(2)).sum::<f32>() / COUNT).sqrt();
        }
        [means, deviations]
    }

    /// Hands the correlation of windows of `own` and `other` to `with`, where both show something.
    fn correlate(
        &mut self,
        own: &[f32],
        means: &[f32],
        deviations: &[f32],
        other: &[f32],
        mut with: impl FnMut(usize, f32),
    ) {
        let width = self.width;
        if width < SIDE || self.height < SIDE {
            return;
        }
        let [sums, squares, products] = &mut self.rows;
        for v in 0..self.height {
            let row = v * width..(v + 1) * width;
            let (own, other) = (&own[row.clone()], &other[row.clone()]);
            let out = [&mut sums[row.clone()], &mut squares[row.clone()], &mut products[row]];
            let [sums, squares, products] = out.map(|out| &mut out[HALF..]);
            for ((((own, other), sum), square), product) in
                own.windows(SIDE).zip(other.windows(SIDE)).zip(sums).zip(squares).zip(products)
            {
                *sum = other[0] + other[1] + other[2] + other[3] + other[4];
                *square = other.iter().map(|b| b * b).sum();
                *product = own.iter().zip(other).map(|(a, b)| a * b).sum();
            }
        }
        for v in HALF..self.height - HALF {
            for u in HALF..width - HALF {
                let pixel = v * width + u;
                let corners = [pixel - HALF * width, pixel + HALF * width].map(|row| [row - HALF, row + HALF]);
                if deviations[pixel] < MIN_DEVIATION || corners.as_flattened().iter().any(|&at| other[at] < 0.0) {
                    continue;
                }
                let over = |rows: &[f32]| {
                    let at = |k: usize| rows[pixel + k * width - HALF * width];
                    (at(0) + at(1) + at(2) + at(3) + at(4)) / COUNT
                };
                let [mean, square, product] = [over(sums), over(squares), over(products)];
                let deviation = (square - mean * mean).max(0.0).sqrt().max(0.5 * MIN_DEVIATION);
                with(pixel, (product - means[pixel] * mean) / (deviations[pixel] * deviation));
            }
        }
    }
}
