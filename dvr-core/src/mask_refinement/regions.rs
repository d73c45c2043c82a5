//! Regions of pixels in an image of flags, row by row.

use crate::flood::flood;

/// How far from the outline, in pixels, a mask may be wrong; what is farther away gives the colours of its kind.
pub(super) const REACH: usize = 6;

/// Regions of what is not set that do not reach the frame, as their pixels; they are connected by edges.
pub(super) fn enclosed_regions(set: &[bool], [width, height]: [usize; 2]) -> Vec<Vec<usize>> {
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
    // What reaches the frame goes first: what is left is enclosed.
    for start in (0..set.len()).filter(|&pixel| on_frame(pixel)) {
        if left[start] {
            flood(start, &mut left, beside);
        }
    }
    let mut enclosed = Vec::new();
    for start in 0..set.len() {
        if left[start] {
            enclosed.push(flood(start, &mut left, beside));
        }
    }
    enclosed
}

/// What lies in a square of [`REACH`] around something that is set. (Exact distances,
/// `distance_transform::signed_distance`, take longer than all else here.)
pub(super) fn near(set: &[bool], [width, height]: [usize; 2]) -> Vec<bool> {
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
