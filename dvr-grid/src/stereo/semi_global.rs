//! Semi-global matching (Hirschmueller 2008): costs summed along eight directions, with a price for depths that change
//! from pixel to pixel.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};

use super::cost_volume::{CostVolume, Part};

/// Price of a change by one plane, in units of correlation.
pub(super) const SLANT: f32 = 0.05;

/// Price of a larger change where brightness does not change; it falls with the contrast.
pub(super) const JUMP: f32 = 0.4;

/// Difference of brightness that halves the price of a jump.
pub(super) const CONTRAST: f32 = 0.08;

/// Columns and rows from pixel to pixel.
pub(super) const DIRECTIONS: [[i32; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, 1], [1, -1], [-1, -1]];

/// The aggregated costs, laid out as those of the volume.
pub(super) fn aggregate(volume: &CostVolume) -> Vec<f32> {
    let mut sums = vec![0.0; volume.costs.len()];
    let arch = Arch::new();
    for direction in DIRECTIONS {
        arch.dispatch(Along { volume, direction, sums: &mut sums });
    }
    sums
}

/// Adds the costs along one direction.
struct Along<'a> {
    volume: &'a CostVolume,
    direction: [i32; 2],
    sums: &'a mut [f32],
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Along<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { volume, direction: [dx, dy], sums } = self;
        let Part { width, height, .. } = volume.layout.part;
        let planes = volume.layout.planes;
        // Costs of the row before and of this one on their paths, and of the pixel before.
        let (mut before, mut here) = (Row::new(width, planes), Row::new(width, planes));
        let mut old = vec![f32::INFINITY; planes + 2];
        for row in 0..height {
            let y = if dy < 0 { height - 1 - row } else { row };
            for column in 0..width {
                let x = if dx < 0 { width - 1 - column } else { column };
                let pixel = y * width + x;
                let (planes, at) = volume.layout.planes_of(pixel);
                if planes.is_empty() {
                    continue;
                }
                let costs = &volume.costs[at.clone()];
                let from = came_from(volume, [x, y], [dx, dy]).map(|from| {
                    let (there, _) = volume.layout.planes_of(from);
                    let row = if dy == 0 { &here } else { &before };
                    around(&planes, &there, row.costs(from % width), &mut old);
                    (from, row.least[from % width])
                });
                let own = &mut here.costs_mut(x)[..costs.len()];
                match from {
                    Some((from, least)) => {
                        let contrast = (volume.grey[pixel] - volume.grey[from]).abs() / CONTRAST;
                        let jump = (JUMP / (1.0 + contrast)).max(SLANT);
                        step(costs, &old, least, jump, own);
                    }
                    None => own.copy_from_slice(costs),
                }
                sums[at].iter_mut().zip(&*own).for_each(|(sum, cost)| *sum += cost);
                let least = least(own);
                here.least[x] = least;
            }
            if dy != 0 {
                std::mem::swap(&mut before, &mut here);
            }
        }
    }
}

/// The pixel before on the path, where there is one that lies in the hull.
#[inline(always)]
fn came_from(volume: &CostVolume, [x, y]: [usize; 2], [dx, dy]: [i32; 2]) -> Option<usize> {
    let Part { width, height, .. } = volume.layout.part;
    let x = x.checked_add_signed(-dx as isize).filter(|&x| x < width)?;
    let y = y.checked_add_signed(-dy as isize).filter(|&y| y < height)?;
    let pixel = y * width + x;
    (!volume.layout.planes_of(pixel).0.is_empty()).then_some(pixel)
}

/// Costs of a row of pixels on their paths, each from its first plane on, and the least of each.
struct Row {
    costs: Vec<f32>,
    least: Vec<f32>,
    planes: usize,
}

impl Row {
    fn new(width: usize, planes: usize) -> Self {
        Self { costs: vec![f32::INFINITY; width * planes], least: vec![0.0; width], planes }
    }

    #[inline(always)]
    fn costs(&self, x: usize) -> &[f32] {
        &self.costs[x * self.planes..][..self.planes]
    }

    #[inline(always)]
    fn costs_mut(&mut self, x: usize) -> &mut [f32] {
        &mut self.costs[x * self.planes..][..self.planes]
    }
}

/// Writes the costs of the planes `there`, given from the first one on, from the plane before `planes` to the one behind
/// them; without a limit for others.
#[inline(always)]
fn around(planes: &Range<usize>, there: &Range<usize>, costs: &[f32], out: &mut [f32]) {
    // From here on, places are one behind planes.
    let out = &mut out[..planes.len() + 2];
    out.fill(f32::INFINITY);
    let (first, last) = (planes.start.max(there.start + 1), (planes.end + 2).min(there.end + 1));
    if first < last {
        let costs = &costs[first - 1 - there.start..last - 1 - there.start];
        out[first - planes.start..last - planes.start].copy_from_slice(costs);
    }
}

/// The costs of a pixel, given those of the one before on the path, `old`, from one plane before on.
#[inline(always)]
fn step(costs: &[f32], old: &[f32], least: f32, jump: f32, out: &mut [f32]) {
    let (limit, n) = (least + jump, costs.len());
    let (left, middle, right, out) = (&old[..n], &old[1..][..n], &old[2..][..n], &mut out[..n]);
    for k in 0..n {
        out[k] = costs[k] + lesser(lesser(middle[k], lesser(left[k], right[k]) + SLANT), limit) - least;
    }
}

/// The least of some costs.
#[inline(always)]
fn least(costs: &[f32]) -> f32 {
    const LANES: usize = 16;
    let (chunks, rest) = costs.as_chunks::<LANES>();
    let mut least = [f32::INFINITY; LANES];
    for chunk in chunks {
        for lane in 0..LANES {
            least[lane] = lesser(least[lane], chunk[lane]);
        }
    }
    least.iter().chain(rest).fold(f32::INFINITY, |a, &b| lesser(a, b))
}

/// One instruction, unlike [`f32::min`], which looks for what is not a number.
#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::cost_volume::VolumeLayout;
    use super::*;

    /// A volume whose depths cost all the same.
    fn unknown([width, height]: [usize; 2], planes: usize, ranges: Vec<[u16; 2]>, grey: Vec<f32>) -> CostVolume {
        let part = Part { left: 0, top: 0, width, height };
        CostVolume::unknown(VolumeLayout::of_ranges(part, [1.0, 0.1], planes, ranges), grey)
    }

    /// A volume of 9x9 pixels and 12 planes, with these costs.
    fn volume(cost: impl Fn(usize, usize, usize) -> f32) -> CostVolume {
        let (width, height, planes) = (9, 9, 12);
        let costs = (0..width * height)
            .flat_map(|pixel| (0..planes).map(move |plane| (pixel, plane)))
            .map(|(pixel, plane)| cost(pixel % width, pixel / width, plane))
            .collect();
        let ranges = vec![[0, planes as u16 - 1]; width * height];
        let mut volume = unknown([width, height], planes, ranges, vec![0.5; width * height]);
        volume.costs = costs;
        volume
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

    /// Costs along one direction by the definition, of all planes of all pixels; infinite where none may lie.
    fn by_definition(volume: &CostVolume, [dx, dy]: [i32; 2]) -> Vec<Vec<f32>> {
        let [width, height] = [volume.layout.part.width, volume.layout.part.height].map(|side| side as i32);
        let mut found = vec![vec![f32::INFINITY; volume.layout.planes]; volume.layout.pixels()];
        for i in 0..width * height {
            let (column, row) = (i % width, i / width);
            let x = if dx < 0 { width - 1 - column } else { column };
            let y = if dy < 0 { height - 1 - row } else { row };
            let pixel = (y * width + x) as usize;
            let (planes, at) = volume.layout.planes_of(pixel);
            let is_there = (0..width).contains(&(x - dx)) && (0..height).contains(&(y - dy));
            let before = is_there.then(|| ((y - dy) * width + x - dx) as usize);
            let before = before.filter(|&before| !volume.layout.planes_of(before).0.is_empty());
            for (plane, cost) in planes.zip(at) {
                let least = before.map(|before| {
                    let old = &found[before];
                    let least = old.iter().copied().fold(f32::INFINITY, f32::min);
                    let contrast = (volume.grey[pixel] - volume.grey[before]).abs() / CONTRAST;
                    let beside =
                        [plane.wrapping_sub(1), plane + 1].map(|k| old.get(k).copied().unwrap_or(f32::INFINITY));
                    let slanted = beside[0].min(beside[1]) + SLANT;
                    old[plane].min(slanted).min(least + (JUMP / (1.0 + contrast)).max(SLANT)) - least
                });
                found[pixel][plane] = volume.costs[cost] + least.unwrap_or(0.0);
            }
        }
        found
    }

    #[test]
    fn costs_of_pixels_with_ranges_of_their_own_are_those_of_the_definition() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (width, height, planes) = (13, 11, 40);
        let range = |rng: &mut ChaCha8Rng| {
            let [a, b] = [0, 1].map(|_| rng.random_range(0..planes as u16));
            // Some pixels lie out of the hull.
            if rng.random_range(0..5) == 0 { [1, 0] } else { [a.min(b), a.max(b)] }
        };
        let ranges = (0..width * height).map(|_| range(&mut rng)).collect();
        let grey = (0..width * height).map(|_| rng.random()).collect();
        let mut volume = unknown([width, height], planes, ranges, grey);
        volume.costs.iter_mut().for_each(|cost| *cost = rng.random());
        let found = aggregate(&volume);
        let mut expected = vec![0.0; found.len()];
        for direction in DIRECTIONS {
            let along = by_definition(&volume, direction);
            for (pixel, along) in along.iter().enumerate() {
                let (planes, at) = volume.layout.planes_of(pixel);
                expected[at].iter_mut().zip(&along[planes]).for_each(|(sum, cost)| *sum += cost);
            }
        }
        assert!(found.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 1e-4));
        assert!(found.len() > 1000 && found.iter().any(|&cost| cost > 2.0));
    }
}
