//! How well the patches of a view match what a neighbour shows on a plane.

use glam::Vec3;
use pulp::NullaryFnOnce;

use super::cost_volume::{CostVolume, Part, Window};
use super::picture::Picture;

/// Half the side of the patches that are compared, pixels.
pub(super) const HALF: usize = 3;

/// Variance of brightness that noise alone may have.
pub(super) const NOISE: f32 = 1e-4;

/// Samples of a patch that both views must show.
pub(super) const MIN_SAMPLES: f32 = 20.0;

/// Sums of the columns of patches: samples that both views show, brightness in each, squares of each, and products.
type Columns = [Vec<f32>; 6];

/// Working space of a view.
pub(super) struct Space {
    /// What the neighbour shows, and whether it shows anything: 1 or 0.
    seen: Vec<f32>,
    is_seen: Vec<f32>,
    /// The two best correlations.
    pub best: Vec<[f32; 2]>,
    columns: Columns,
    correlations: Vec<f32>,
    places: Places,
}

impl Space {
    pub fn new(part: &Part) -> Self {
        let pixels = part.width * part.height;
        Self {
            seen: vec![0.0; pixels],
            is_seen: vec![0.0; pixels],
            best: vec![[-1.0; 2]; pixels],
            columns: std::array::from_fn(|_| vec![0.0; part.width]),
            correlations: vec![0.0; part.width],
            places: Places::new(part.width),
        }
    }
}

/// Matches the pixels of a window with what `other` shows on the plane of constant depth, and keeps the two best
/// correlations of each.
pub(super) struct Match<'a> {
    pub volume: &'a CostVolume,
    pub own: &'a Picture,
    pub other: &'a Picture,
    pub depth: f32,
    pub window: Window,
    pub space: &'a mut Space,
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Match<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { volume, own, other, depth, window, space } = self;
        warp(own, other, depth, &volume.layout.part, &window, space);
        correlate(volume, &window, space);
    }
}

/// Rows or columns with those that patches reach into, up to the side of a picture.
#[inline(always)]
fn reached([first, last]: [usize; 2], side: usize) -> [usize; 2] {
    [first.saturating_sub(HALF), (last + HALF).min(side)]
}

/// Carries what `other` shows to `own`, by the plane of constant depth.
#[inline(always)]
fn warp(own: &Picture, other: &Picture, depth: f32, part: &Part, window: &Window, space: &mut Space) {
    let ([top, bottom], [left, right]) = (reached(window.rows, part.height), reached(window.columns, part.width));
    let base = other.camera.projection * own.camera.center + other.camera.offset;
    let matrix = other.camera.projection * own.camera.to_direction * depth;
    for row in top..bottom {
        let start = Vec3::new(part.left as f32 + 0.5, (part.top + row) as f32 + 0.5, 1.0);
        let line = Line { first: base + matrix * start, step: matrix.x_axis };
        let columns = row * part.width + left..row * part.width + right;
        let (seen, is_seen) = (&mut space.seen[columns.clone()], &mut space.is_seen[columns]);
        space.places.look(&line, left, other, seen, is_seen);
    }
}

/// Homogeneous places of a row's pixels in a neighbour: of the first, and from each to the next.
struct Line {
    first: Vec3,
    step: Vec3,
}

/// Where the pixels of a row lie in a neighbour, and what that shows there: numbers of all pixels side by side.
struct Places {
    q: [Vec<f32>; 3],
    /// The upper left of the four pixels around, and how far from it to the right and down.
    pixel: Vec<u32>,
    right: Vec<f32>,
    down: Vec<f32>,
    /// Whether all four are in the frame: 1 or 0.
    is_inside: Vec<f32>,
    corners: [Vec<f32>; 4],
}

impl Places {
    fn new(width: usize) -> Self {
        let row = || vec![0.0; width];
        Self {
            q: std::array::from_fn(|_| row()),
            pixel: vec![0; width],
            right: row(),
            down: row(),
            is_inside: row(),
            corners: std::array::from_fn(|_| row()),
        }
    }

    /// What `other` shows of the pixels of a row, from the column `skip` on, less a half; and whether it shows anything.
    #[inline(always)]
    fn look(&mut self, line: &Line, skip: usize, other: &Picture, seen: &mut [f32], is_seen: &mut [f32]) {
        let n = seen.len();
        if other.width < 2 || other.height < 2 {
            [seen, is_seen].into_iter().for_each(|row| row.fill(0.0));
            return;
        }
        let [x, y, z] = &mut self.q;
        let (x, y, z) = (&mut x[..n], &mut y[..n], &mut z[..n]);
        // One after the other: rounding adds up.
        let mut q = line.first;
        (0..skip).for_each(|_| q += line.step);
        for i in 0..n {
            [x[i], y[i], z[i]] = q.to_array();
            q += line.step;
        }
        let (wide, high) = (other.width as f32 - 1.0, other.height as f32 - 1.0);
        let (pixel, is_inside) = (&mut self.pixel[..n], &mut self.is_inside[..n]);
        let (right, down) = (&mut self.right[..n], &mut self.down[..n]);
        for i in 0..n {
            let inverse = z[i].recip();
            let (x, y) = (x[i] * inverse - 0.5, y[i] * inverse - 0.5);
            let inside = (x >= 0.0) & (y >= 0.0) & (x < wide) & (y < high);
            let (x, y) = (if inside { x } else { 0.0 }, if inside { y } else { 0.0 });
            // Not negative: cut off is rounded down.
            let (u, v) = (x as i32, y as i32);
            (right[i], down[i]) = (x - u as f32, y - v as f32);
            pixel[i] = v as u32 * other.width as u32 + u as u32;
            is_inside[i] = if inside { 1.0 } else { 0.0 };
        }
        let [a, b, c, d] = &mut self.corners;
        let (a, b, c, d) = (&mut a[..n], &mut b[..n], &mut c[..n], &mut d[..n]);
        for i in 0..n {
            let at = pixel[i] as usize;
            let (above, below) = (&other.grey[at..at + 2], &other.grey[at + other.width..at + other.width + 2]);
            (a[i], b[i], c[i], d[i]) = (above[0], above[1], below[0], below[1]);
        }
        for i in 0..n {
            let (above, below) = (a[i] + right[i] * (b[i] - a[i]), c[i] + right[i] * (d[i] - c[i]));
            let value = above + down[i] * (below - above);
            // Not a number off the object.
            let shows = (is_inside[i] > 0.0) & !value.is_nan();
            seen[i] = if shows { value - 0.5 } else { 0.0 };
            is_seen[i] = if shows { 1.0 } else { 0.0 };
        }
    }
}

/// Correlates the patches around each pixel of a window with what was carried there, and keeps the two best.
#[inline(always)]
fn correlate(volume: &CostVolume, window: &Window, space: &mut Space) {
    let Part { width, height, .. } = volume.layout.part;
    let Space { seen, is_seen, best, columns, correlations, .. } = space;
    // Patches lie within the picture.
    let [first, last] = [window.columns[0].max(HALF), window.columns[1].min(width.saturating_sub(HALF))];
    if first >= last {
        return;
    }
    let [left, right] = [first - HALF, last + HALF];
    columns.iter_mut().for_each(|column| column[left..right].fill(0.0));
    let [top, bottom] = window.rows;
    for row in top.saturating_sub(HALF)..(top + HALF).min(height) {
        add_row(volume, seen, is_seen, row, [left, right], 1.0, columns);
    }
    for row in top..bottom {
        if row + HALF < height {
            add_row(volume, seen, is_seen, row + HALF, [left, right], 1.0, columns);
        }
        if row > top && row > HALF {
            add_row(volume, seen, is_seen, row - HALF - 1, [left, right], -1.0, columns);
        }
        let found = &mut correlations[first..last];
        correlate_columns(columns, left, found);
        for (best, &found) in best[row * width + first..row * width + last].iter_mut().zip(&*found) {
            let [first, second] = *best;
            *best = [first.max(found), second.max(first.min(found))];
        }
    }
}

/// Adds the pixels of a row between two columns to the sums of columns, or takes them away with the sign -1.
#[inline(always)]
fn add_row(
    volume: &CostVolume,
    seen: &[f32],
    is_seen: &[f32],
    row: usize,
    [left, right]: [usize; 2],
    sign: f32,
    columns: &mut Columns,
) {
    let (at, count) = (row * volume.layout.part.width + left, right - left);
    let (grey, seen, is_seen) = (&volume.grey[at..][..count], &seen[at..][..count], &is_seen[at..][..count]);
    let [n, r, w, rr, ww, rw] = columns.each_mut().map(|column| &mut column[left..right]);
    for x in 0..count {
        let own = grey[x] - 0.5;
        let is_own = !own.is_nan();
        let (own, valid) = (if is_own { own } else { 0.0 }, if is_own { sign * is_seen[x] } else { 0.0 });
        let other = seen[x];
        n[x] += valid;
        r[x] += valid * own;
        w[x] += valid * other;
        rr[x] += valid * own * own;
        ww[x] += valid * other * other;
        rw[x] += valid * own * other;
    }
}

/// The correlations of patches, given the sums of columns; those of the first patch begin at the column `left`.
#[inline(always)]
fn correlate_columns(columns: &Columns, left: usize, correlations: &mut [f32]) {
    let count = correlations.len() + 2 * HALF;
    let [n, r, w, rr, ww, rw] = columns.each_ref().map(|column| &column[left..left + count]);
    for (x, out) in correlations.iter_mut().enumerate() {
        let sum = |column: &[f32]| column[x..x + 2 * HALF + 1].iter().sum::<f32>();
        let (n, r, w, rr, ww, rw) = (sum(n), sum(r), sum(w), sum(rr), sum(ww), sum(rw));
        let mean = 1.0 / n.max(1.0);
        let own = (rr - r * r * mean) * mean;
        let other = (ww - w * w * mean) * mean;
        let both = (rw - r * w * mean) * mean;
        let found = both / ((own.max(0.0) + NOISE) * (other.max(0.0) + NOISE)).sqrt();
        *out = if n >= MIN_SAMPLES { found } else { -1.0 };
    }
}
