//! Semi-global matching (Hirschmueller 2008): costs summed along eight directions, with a price for depths that change
//! from pixel to pixel.

use pulp::Arch;

use super::cost_volume::CostVolume;

/// Price of a change by one plane, in units of correlation.
const SLANT: f32 = 0.05;

/// Price of a larger change where brightness does not change; it falls with the contrast.
const JUMP: f32 = 0.4;

/// Difference of brightness that halves the price of a jump.
const CONTRAST: f32 = 0.08;

/// The aggregated costs, laid out as those of the volume.
pub(super) fn aggregate(volume: &CostVolume) -> Vec<f32> {
    let mut sums = vec![0.0; volume.costs.len()];
    let arch = Arch::new();
    for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)] {
        arch.dispatch(|| along(volume, dx, dy, &mut sums));
    }
    sums
}

/// Adds the costs along one direction.
#[inline(always)]
fn along(volume: &CostVolume, dx: i32, dy: i32, sums: &mut [f32]) {
    let (width, height, planes) = (volume.width, volume.height, volume.planes);
    // Costs of the row before and of this one, and of the pixel before on the path.
    let (mut before, mut here) = (Row::new(width, planes), Row::new(width, planes));
    let mut old = vec![f32::INFINITY; planes];
    for row in 0..height {
        let y = if dy < 0 { height - 1 - row } else { row };
        for column in 0..width {
            let x = if dx < 0 { width - 1 - column } else { column };
            let pixel = y * width + x;
            let [first, last] = volume.ranges[pixel].map(usize::from);
            if first > last {
                continue;
            }
            let from = came_from(volume, [x, y], [dx, dy]);
            let least = from.map(|from| {
                let row = if dy == 0 { &here } else { &before };
                old.copy_from_slice(row.costs(from % width));
                row.least[from % width]
            });
            let costs = &volume.costs[pixel * planes..(pixel + 1) * planes];
            let own = &mut here.costs[x * planes..(x + 1) * planes];
            own.fill(f32::INFINITY);
            match (from, least) {
                (Some(from), Some(least)) => {
                    let contrast = (volume.grey[pixel] - volume.grey[from]).abs() / CONTRAST;
                    let jump = (JUMP / (1.0 + contrast)).max(SLANT);
                    step(&costs[first..=last], &old, first, least, jump, &mut own[first..=last]);
                }
                _ => own[first..=last].copy_from_slice(&costs[first..=last]),
            }
            let sums = &mut sums[pixel * planes..(pixel + 1) * planes];
            sums[first..=last].iter_mut().zip(&own[first..=last]).for_each(|(sum, cost)| *sum += cost);
            here.least[x] = own[first..=last].iter().copied().fold(f32::INFINITY, f32::min);
        }
        if dy != 0 {
            std::mem::swap(&mut before, &mut here);
        }
    }
}

/// The pixel before on the path, where there is one that lies in the hull.
fn came_from(volume: &CostVolume, [x, y]: [usize; 2], [dx, dy]: [i32; 2]) -> Option<usize> {
    let x = x.checked_add_signed(-dx as isize).filter(|&x| x < volume.width)?;
    let y = y.checked_add_signed(-dy as isize).filter(|&y| y < volume.height)?;
    let pixel = y * volume.width + x;
    let [first, last] = volume.ranges[pixel];
    (first <= last).then_some(pixel)
}

/// Costs of a row of pixels on their paths, and the least of each.
struct Row {
    costs: Vec<f32>,
    least: Vec<f32>,
    planes: usize,
}

impl Row {
    fn new(width: usize, planes: usize) -> Self {
        Self { costs: vec![f32::INFINITY; width * planes], least: vec![0.0; width], planes }
    }

    fn costs(&self, x: usize) -> &[f32] {
        &self.costs[x * self.planes..(x + 1) * self.planes]
    }
}

/// The costs of a pixel, given those of the one before on the path.
#[inline(always)]
fn step(costs: &[f32], old: &[f32], first: usize, least: f32, jump: f32, out: &mut [f32]) {
    let planes = old.len();
    let limit = least + jump;
    let value = |k: usize, left: f32, middle: f32, right: f32| {
        costs[k] + middle.min(left.min(right) + SLANT).min(limit) - least
    };
    let count = costs.len();
    let inner = usize::from(first == 0)..count - usize::from(first + count == planes);
    for k in 0..inner.start.min(count) {
        out[k] = value(k, f32::INFINITY, old[first + k], old.get(first + k + 1).copied().unwrap_or(f32::INFINITY));
    }
    if inner.start < inner.end {
        let n = inner.len();
        let from = first + inner.start;
        let (left, middle, right) = (&old[from - 1..][..n], &old[from..][..n], &old[from + 1..][..n]);
        let (costs, out) = (&costs[inner.clone()], &mut out[inner.clone()]);
        for k in 0..n {
            out[k] = costs[k] + middle[k].min(left[k].min(right[k]) + SLANT).min(limit) - least;
        }
    }
    for k in inner.end.max(inner.start)..count {
        let left = if first + k > 0 { old[first + k - 1] } else { f32::INFINITY };
        out[k] = value(k, left, old[first + k], f32::INFINITY);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A volume of 9x9 pixels and 12 planes, with these costs.
    fn volume(cost: impl Fn(usize, usize, usize) -> f32) -> CostVolume {
        let (width, height, planes) = (9, 9, 12);
        let costs = (0..width * height)
            .flat_map(|pixel| (0..planes).map(move |plane| (pixel, plane)))
            .map(|(pixel, plane)| cost(pixel % width, pixel / width, plane))
            .collect();
        CostVolume {
            width,
            height,
            near: 1.0,
            step: 0.1,
            planes,
            costs,
            ranges: vec![[0, planes as u16 - 1]; width * height],
            grey: vec![0.5; width * height],
        }
    }

    #[test]
    fn a_pixel_that_matches_elsewhere_by_chance_follows_its_neighbours_on_a_slope() {
        // A plane that slopes by one depth in two pixels; the middle matches another depth a little better.
        let volume = volume(|x, y, plane| match (x, y, plane) {
            (4, 4, 10) => 0.05,
            _ if plane == 2 + x / 2 => 0.1,
            _ => 0.8,
        });
        let aggregated = aggregate(&volume);
        for pixel in 0..81 {
            let (depth, _) = volume.best(&aggregated, pixel).unwrap_or((f32::NAN, 0.0));
            let expected = 1.0 + 0.1 * (2 + pixel % 9 / 2) as f32;
            assert!(pixel == 40 || (depth - expected).abs() < 0.051, "{pixel}: {depth} is not {expected}");
        }
        let costs = &aggregated[40 * 12..41 * 12];
        assert!(costs[4] < costs[10], "{costs:?}");
    }
}
