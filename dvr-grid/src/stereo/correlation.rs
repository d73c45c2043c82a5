//! How well the patches of a view match what a neighbour shows on a plane.

use glam::Vec3;

use super::cost_volume::{CostVolume, Part};
use super::picture::Picture;

/// Half the side of the patches that are compared, pixels.
const HALF: usize = 3;

/// Variance of brightness that noise alone may have.
const NOISE: f32 = 1e-4;

/// Samples of a patch that both views must show.
const MIN_SAMPLES: f32 = 20.0;

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
        }
    }
}

/// Carries what `other` shows to `own`, by the plane of constant depth.
pub(super) fn warp(own: &Picture, other: &Picture, depth: f32, part: &Part, rows: [usize; 2], space: &mut Space) {
    let (first, last) = (rows[0].saturating_sub(HALF), (rows[1] + HALF).min(part.height));
    let base = other.camera.projection * own.camera.center + other.camera.offset;
    let matrix = other.camera.projection * own.camera.to_direction * depth;
    let (wide, high) = (other.width as f32 - 1.0, other.height as f32 - 1.0);
    for row in first..last {
        let start = Vec3::new(part.left as f32 + 0.5, (part.top + row) as f32 + 0.5, 1.0);
        let (mut q, step) = (base + matrix * start, matrix.x_axis);
        let own_row = row * part.width..(row + 1) * part.width;
        for (seen, is_seen) in space.seen[own_row.clone()].iter_mut().zip(&mut space.is_seen[own_row]) {
            let inverse = q.z.recip();
            let (x, y) = (q.x * inverse - 0.5, q.y * inverse - 0.5);
            q += step;
            let mut value = f32::NAN;
            if x >= 0.0 && y >= 0.0 && x < wide && y < high {
                let (u, v) = (x as usize, y as usize);
                let (s, t) = (x - u as f32, y - v as f32);
                let at = v * other.width + u;
                let (above, below) = (&other.grey[at..at + 2], &other.grey[at + other.width..at + other.width + 2]);
                let (a, b) = (above[0] + s * (above[1] - above[0]), below[0] + s * (below[1] - below[0]));
                value = a + t * (b - a);
            }
            // Not a number off the object.
            (*seen, *is_seen) = if value.is_nan() { (0.0, 0.0) } else { (value - 0.5, 1.0) };
        }
    }
}

/// Correlates the patches around each pixel of some rows with what was carried there, and keeps the two best.
#[inline(always)]
pub(super) fn correlate(volume: &CostVolume, rows: [usize; 2], space: &mut Space) {
    let (width, height) = (volume.width, volume.height);
    let Space { seen, is_seen, best, columns, correlations } = space;
    columns.iter_mut().for_each(|column| column.fill(0.0));
    let add = |row: usize, sign: f32, columns: &mut Columns| {
        let range = row * width..(row + 1) * width;
        add_row(&volume.grey[range.clone()], &seen[range.clone()], &is_seen[range], sign, columns);
    };
    for row in rows[0].saturating_sub(HALF)..(rows[0] + HALF).min(height) {
        add(row, 1.0, columns);
    }
    for row in rows[0]..rows[1] {
        if row + HALF < height {
            add(row + HALF, 1.0, columns);
        }
        if row > rows[0] && row > HALF {
            add(row - HALF - 1, -1.0, columns);
        }
        correlations.fill(-1.0);
        if width > 2 * HALF {
            correlate_columns(columns, &mut correlations[HALF..width - HALF]);
        }
        for (best, &found) in best[row * width..(row + 1) * width].iter_mut().zip(&*correlations) {
            let [first, second] = *best;
            *best = [first.max(found), second.max(first.min(found))];
        }
    }
}

/// Adds a row of pixels to the sums of columns, or takes it away with the sign -1.
#[inline(always)]
fn add_row(grey: &[f32], seen: &[f32], is_seen: &[f32], sign: f32, columns: &mut Columns) {
    let [n, r, w, rr, ww, rw] = columns;
    for x in 0..grey.len() {
        let own = grey[x] - 0.5;
        let (own, valid) = if own.is_nan() { (0.0, 0.0) } else { (own, sign * is_seen[x]) };
        let other = seen[x];
        n[x] += valid;
        r[x] += valid * own;
        w[x] += valid * other;
        rr[x] += valid * own * own;
        ww[x] += valid * other * other;
        rw[x] += valid * own * other;
    }
}

/// The correlations of patches, given the sums of their columns.
#[inline(always)]
fn correlate_columns(columns: &Columns, correlations: &mut [f32]) {
    let [n, r, w, rr, ww, rw] = columns;
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
