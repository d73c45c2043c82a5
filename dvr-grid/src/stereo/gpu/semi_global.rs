//! Semi-global matching, and the depth of least cost, inside kernels: the counterpart of [`super::super::semi_global`] and
//! of [`super::super::cost_volume::CostVolume::best`].
//!
//! A group of work-items goes along one path, pixel by pixel; each looks after some depths.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::super::cost_volume::{MIN_CORRELATION, ROOM, VolumeLayout};
use super::super::semi_global::{CONTRAST, JUMP, SLANT};
use super::sweep::Depths;
use crate::gpu::launch::UNITS;
use crate::gpu::views::photo;

/// More than any cost.
const NEVER: f32 = 1.0e30;

/// Numbers of a depth that was found: z-depth, and how sure it is.
pub(super) const FOUND: usize = 2;

/// Work-items that take the least of several.
const REDUCING: usize = 8;

/// The paths along a direction: where each begins, and how many pixels it has. A path ends where the hull does, since nothing is
/// handed on from there.
pub(super) fn paths(layout: &VolumeLayout, [dx, dy]: [i32; 2]) -> Vec<u32> {
    let [width, height] = [layout.part.width, layout.part.height].map(|side| side as i32);
    let [column, row] = [if dx < 0 { width - 1 } else { 0 }, if dy < 0 { height - 1 } else { 0 }];
    let from_row = (0..width).filter(|_| dy != 0).map(|x| [x, row]);
    let from_column = (0..height).filter(|&y| dx != 0 && (dy == 0 || y != row)).map(|y| [column, y]);
    let mut paths = Vec::new();
    for [mut x, mut y] in from_row.chain(from_column) {
        let mut is_on_path = false;
        while (0..width).contains(&x) && (0..height).contains(&y) {
            let is_in_hull = !layout.planes_of((y * width + x) as usize).0.is_empty();
            match (is_in_hull, is_on_path, paths.last_mut()) {
                (true, true, Some(length)) => *length += 1,
                (true, ..) => paths.extend([x as u32, y as u32, 1]),
                (false, ..) => {}
            }
            is_on_path = is_in_hull;
            (x, y) = (x + dx, y + dy);
        }
    }
    paths
}

/// Adds the costs along `count` paths, of which each goes by `(dx, dy)` from pixel to pixel, negative ones as words that wrap.
#[cube(launch)]
pub(super) fn add_along(
    paths: &[u32],
    views: &[u32],
    grey: &[f32],
    ranges: &[u32],
    starts: &[u32],
    costs: &[f32],
    sums: &mut [f32],
    depths: Depths,
    view: u32,
    dx: u32,
    dy: u32,
    count: u32,
) {
    // Costs of the pixel before and of this one, in turns.
    let mut rows = Shared::<[f32]>::new_slice(comptime!(2 * ROOM));
    let mut least_of_unit = Shared::<[f32]>::new_slice(UNITS);
    let mut least_of_some = Shared::<[f32]>::new_slice(REDUCING);
    let unit = UNIT_POS as usize;
    let photo = photo(views, view);
    let path = 3 * min(CUBE_POS as u32, count - 1u32) as usize;
    let is_path = (CUBE_POS as u32) < count;
    let mut x = paths[path];
    let mut y = paths[path + 1];
    let length = paths[path + 2];
    let mut least = 0.0f32;
    let mut grey_before = 0.0f32;
    // The depths of the pixel before, none at first, and where their costs lie.
    let mut old_first = 0usize;
    let mut old_end = 0usize;
    let mut old = 0usize;
    for _ in 0..length {
        let pixel = (y * depths.width + x) as usize;
        let (first, end) = (ranges[2 * pixel] as usize, ranges[2 * pixel + 1] as usize);
        let brightness = grey[photo.index(depths.left + x, depths.top + y)];
        let contrast = (brightness - grey_before).abs() / f32::new(CONTRAST);
        let limit = least + (f32::new(JUMP) / (1.0f32 + contrast)).max(f32::new(SLANT));
        let new = comptime!(ROOM) - old;
        let mut least_here = f32::new(NEVER);
        let mut plane = first + unit;
        while plane < end {
            let at = starts[pixel] as usize + plane - first;
            let mut cost = costs[at];
            if old_end > 0 {
                let mut least_way = limit;
                if plane >= old_first && plane < old_end {
                    least_way = least_way.min(rows[old + plane]);
                }
                if plane > old_first && plane <= old_end {
                    least_way = least_way.min(rows[old + plane - 1] + SLANT);
                }
                if plane + 1 >= old_first && plane + 1 < old_end {
                    least_way = least_way.min(rows[old + plane + 1] + SLANT);
                }
                cost += least_way - least;
            }
            if is_path {
                sums[at] += cost;
            }
            rows[new + plane] = cost;
            least_here = least_here.min(cost);
            plane += UNITS;
        }
        least_of_unit[unit] = least_here;
        sync_cube();
        if unit < REDUCING {
            let mut reduced = f32::new(NEVER);
            for i in 0..comptime!(UNITS / REDUCING) {
                reduced = reduced.min(least_of_unit[unit * comptime!(UNITS / REDUCING) + i]);
            }
            least_of_some[unit] = reduced;
        }
        sync_cube();
        least = f32::new(NEVER);
        for i in 0..REDUCING {
            least = least.min(least_of_some[i]);
        }
        old_first = first;
        old_end = end;
        grey_before = brightness;
        old = new;
        x += dx;
        y += dy;
    }
}

/// The depth of least aggregated cost of each of `count` pixels, between planes, and the correlation there; the depth
/// below zero where there is none.
#[cube(launch)]
pub(super) fn best(
    ranges: &[u32],
    starts: &[u32],
    costs: &[f32],
    sums: &[f32],
    found: &mut [f32],
    depths: Depths,
    count: u32,
) {
    let pixel = ABSOLUTE_POS;
    if pixel < count as usize {
        let (first, end) = (ranges[2 * pixel], ranges[2 * pixel + 1]);
        let start = starts[pixel] as usize;
        let mut depth = f32::new(-1.0);
        let mut correlation = 0.0f32;
        if first < end {
            let length = (end - first) as usize;
            let mut best = 0usize;
            for k in 1..length {
                if sums[start + k] < sums[start + best] {
                    best = k;
                }
            }
            correlation = 1.0f32 - costs[start + best];
            let mut offset = 0.0f32;
            if best > 0 && best + 1 < length {
                let (a, b, c) = (sums[start + best - 1], sums[start + best], sums[start + best + 1]);
                let curvature = a + c - 2.0f32 * b;
                if curvature > 1e-6f32 {
                    offset = (0.5f32 * (a - c) / curvature).clamp(-0.5f32, 0.5f32);
                }
            }
            if correlation > MIN_CORRELATION {
                depth = depths.near + (f32::cast_from(first + best as u32) + offset) * depths.step;
            }
        }
        found[pixel * comptime!(FOUND)] = depth;
        found[pixel * comptime!(FOUND) + 1] = correlation;
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::cost_volume::Part;
    use super::super::super::semi_global::DIRECTIONS;
    use super::*;

    #[test]
    fn every_pixel_of_the_hull_lies_on_one_path_of_each_direction_and_no_path_could_be_longer() {
        for (width, height) in [(5, 4), (1, 3), (4, 1), (1, 1), (7, 9)] {
            let part = Part { left: 3, top: 2, width, height };
            let is_in_hull = |pixel: usize| pixel % 5 != 3;
            let ranges = (0..width * height).map(|pixel| if is_in_hull(pixel) { [2, 4] } else { [1, 0] }).collect();
            let layout = VolumeLayout::of_ranges(part, [1.0, 0.1], 8, ranges);
            for direction in DIRECTIONS {
                let mut seen = vec![0; width * height];
                let pixel = |x: i32, y: i32| {
                    let is_there = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
                    is_there.then(|| y as usize * width + x as usize)
                };
                for path in paths(&layout, direction).as_chunks::<3>().0 {
                    let [mut x, mut y] = [path[0] as i32, path[1] as i32];
                    let before = pixel(x - direction[0], y - direction[1]);
                    assert!(!before.is_some_and(is_in_hull), "{direction:?}: a path begins late");
                    for _ in 0..path[2] {
                        seen[pixel(x, y).unwrap()] += 1;
                        (x, y) = (x + direction[0], y + direction[1]);
                    }
                    assert!(!pixel(x, y).is_some_and(is_in_hull), "{direction:?}: a path ends early");
                }
                let expected: Vec<i32> = (0..width * height).map(|pixel| is_in_hull(pixel).into()).collect();
                assert_eq!(seen, expected, "{direction:?}");
            }
        }
    }
}
