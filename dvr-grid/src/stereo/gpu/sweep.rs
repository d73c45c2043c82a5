//! What the depths of a view's pixels cost, inside a kernel: the counterpart of [`super::super::sweep`] and
//! [`super::super::correlation`].
//!
//! A group of work-items takes the pixels of a tile at one depth. What the view and a neighbour show there, and around it as far as
//! patches reach, is read once.

#![allow(missing_docs)]

use cubecl::prelude::*;
use dvr_core::Pinhole;

use super::super::correlation::{HALF, MIN_SAMPLES, NOISE};
use super::super::cost_volume::{UNKNOWN, VolumeLayout};
use crate::gpu::views::{Photo, photo};
use crate::gpu::voxel::{Point, lerp};

/// Pixels along the side of a tile: one for each work-item.
const TILE: usize = 16;

/// Work-items of a group.
pub(super) const TILE_UNITS: usize = TILE * TILE;

/// Pixels along the side of a tile with all that its patches reach.
const REACH: usize = TILE + 2 * HALF;

/// What is there, where nothing is shown. Brightness less a half is no such number.
const NOTHING: f32 = -4.0;

/// The tiles of a view, each with a depth that one of its pixels may have: first column, first row, depth.
pub(super) fn tiles(layout: &VolumeLayout) -> Vec<u32> {
    let across = layout.part.width.div_ceil(TILE);
    let mut used = vec![false; across * layout.part.height.div_ceil(TILE) * layout.planes];
    for pixel in 0..layout.pixels() {
        let (row, column) = (pixel / layout.part.width, pixel % layout.part.width);
        let tile = row / TILE * across + column / TILE;
        used[tile * layout.planes..][layout.planes_of(pixel).0].fill(true);
    }
    let used = (0..used.len()).filter(|&at| used[at]).map(|at| (at / layout.planes, at % layout.planes));
    used.flat_map(|(tile, plane)| [tile % across * TILE, tile / across * TILE, plane].map(|word| word as u32)).collect()
}

/// The part of a picture that shows the object, and its depths.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(super) struct Depths {
    pub left: u32,
    pub top: u32,
    pub width: u32,
    pub height: u32,
    pub near: f32,
    pub step: f32,
}

impl DepthsLaunch {
    /// Those of a view.
    pub fn of(layout: &VolumeLayout) -> Self {
        let [left, top, width, height] = [layout.part.left, layout.part.top, layout.part.width, layout.part.height];
        Self::new(left as u32, top as u32, width as u32, height as u32, layout.near, layout.step)
    }
}

/// What a picture shows at a pixel, less a half, or [`NOTHING`].
#[cube]
fn shown(photo: &Photo, grey: &[f32], u: u32, v: u32) -> f32 {
    let value = grey[photo.index(u, v)];
    select(value >= 0.0f32, value - 0.5f32, f32::new(NOTHING))
}

/// Numbers of [`carried`].
const CARRIED: usize = 12;

/// How a view's pixels are carried to another view, by the plane of constant depth: where its camera stands there, and the columns of
/// a matrix from pixel coordinates (and 1) to what a unit of depth adds; homogeneous.
pub(super) fn carried(own: &Pinhole, other: &Pinhole) -> [f32; CARRIED] {
    let base = other.projection * own.center + other.offset;
    let matrix = (other.projection * own.to_direction).to_cols_array();
    std::array::from_fn(|i| if i < 3 { base[i] } else { matrix[i - 3] })
}

/// The same in a kernel.
#[derive(CubeType, Clone, Copy)]
struct Carried {
    base: Point,
    by_column: Point,
    by_row: Point,
    by_one: Point,
}

#[cube]
impl Carried {
    fn read(numbers: &[f32], index: usize) -> Carried {
        let at = index * CARRIED;
        Carried {
            base: Point::read(numbers, at),
            by_column: Point::read(numbers, at + 3),
            by_row: Point::read(numbers, at + 6),
            by_one: Point::read(numbers, at + 9),
        }
    }

    /// Where the middle of a pixel at a depth lies.
    fn place(&self, u: u32, v: u32, depth: f32) -> Point {
        let (x, y) = (f32::cast_from(u) + 0.5f32, f32::cast_from(v) + 0.5f32);
        let direction = self.by_column.times(x).plus(&self.by_row.times(y)).plus(&self.by_one);
        self.base.along(&direction, depth)
    }
}

/// What a picture shows at a homogeneous place, less a half, or [`NOTHING`].
#[cube]
fn seen(photo: &Photo, grey: &[f32], q: &Point) -> f32 {
    let (x, y) = (q.x / q.z - 0.5f32, q.y / q.z - 0.5f32);
    let mut value = f32::new(NOTHING);
    let within = x >= 0.0f32
        && y >= 0.0f32
        && x < f32::cast_from(photo.width) - 1.0f32
        && y < f32::cast_from(photo.height) - 1.0f32;
    if within {
        let (u, v) = (u32::cast_from(x), u32::cast_from(y));
        let (right, down) = (x - f32::cast_from(u), y - f32::cast_from(v));
        let a = shown(photo, grey, u, v);
        let b = shown(photo, grey, u + 1u32, v);
        let c = shown(photo, grey, u, v + 1u32);
        let d = shown(photo, grey, u + 1u32, v + 1u32);
        if a.min(b).min(c).min(d) > f32::new(NOTHING) {
            value = lerp(lerp(a, b, right), lerp(c, d, right), down);
        }
    }
    value
}

/// Sums of a patch: samples that both views show, brightness in each, squares of each, and products.
const SUMS: usize = 6;

/// Sums along the rows of the patches of a tile.
const ROW_SUMS: usize = REACH * TILE;

/// Adds up along the rows of patches, of which each unit takes some.
#[cube]
fn add_rows(own: &[f32], other: &[f32], rows: &mut [f32], unit: usize) {
    let mut at = unit;
    while at < comptime!(ROW_SUMS) {
        let first = at / TILE * REACH + at % TILE;
        let mut count = 0.0f32;
        let mut own_sum = 0.0f32;
        let mut other_sum = 0.0f32;
        let mut own_squared = 0.0f32;
        let mut other_squared = 0.0f32;
        let mut product = 0.0f32;
        #[unroll]
        for k in 0..comptime!(2 * HALF + 1) {
            let (a, b) = (own[first + k], other[first + k]);
            if a > f32::new(NOTHING) && b > f32::new(NOTHING) {
                count += 1.0f32;
                own_sum += a;
                other_sum += b;
                own_squared += a * a;
                other_squared += b * b;
                product += a * b;
            }
        }
        rows[at] = count;
        rows[comptime!(ROW_SUMS) + at] = own_sum;
        rows[comptime!(2 * ROW_SUMS) + at] = other_sum;
        rows[comptime!(3 * ROW_SUMS) + at] = own_squared;
        rows[comptime!(4 * ROW_SUMS) + at] = other_squared;
        rows[comptime!(5 * ROW_SUMS) + at] = product;
        at += comptime!(TILE_UNITS);
    }
}

/// One of the sums over a unit's patch.
#[cube]
fn sum(rows: &[f32], unit: usize, #[comptime] which: usize) -> f32 {
    let mut sum = 0.0f32;
    #[unroll]
    for k in 0..comptime!(2 * HALF + 1) {
        sum += rows[comptime!(which * ROW_SUMS + k * TILE) + unit];
    }
    sum
}

/// The correlation of a unit's patch; -1 where too little is shown.
#[cube]
fn correlation(rows: &[f32], unit: usize) -> f32 {
    let (count, own, other) = (sum(rows, unit, 0usize), sum(rows, unit, 1usize), sum(rows, unit, 2usize));
    let mean = 1.0f32 / count.max(1.0f32);
    let own_variance = ((sum(rows, unit, 3usize) - own * own * mean) * mean).max(0.0f32) + NOISE;
    let other_variance = ((sum(rows, unit, 4usize) - other * other * mean) * mean).max(0.0f32) + NOISE;
    let both = (sum(rows, unit, 5usize) - own * other * mean) * mean;
    let found = both / (own_variance * other_variance).sqrt();
    select(count >= MIN_SAMPLES, found, f32::new(-1.0))
}

/// Writes what depths cost: one less the mean of the two best correlations with neighbours.
///
/// `tiles` is what [`tiles`] says, for `count` groups; `carried` what [`carried`] says of each neighbour; `ranges` has the
/// first and one past the last depth of each pixel of the part, `starts` where its costs begin.
#[cube(launch)]
pub(super) fn match_tiles(
    tiles: &[u32],
    views: &[u32],
    grey: &[f32],
    neighbours: &[u32],
    carried: &[f32],
    ranges: &[u32],
    starts: &[u32],
    costs: &mut [f32],
    depths: Depths,
    view: u32,
    neighbour_count: u32,
    count: u32,
) {
    let mut own = Shared::<[f32]>::new_slice(comptime!(REACH * REACH));
    let mut other = Shared::<[f32]>::new_slice(comptime!(REACH * REACH));
    let mut rows = Shared::<[f32]>::new_slice(comptime!(SUMS * ROW_SUMS));
    let group = 3 * min(CUBE_POS as u32, count - 1u32) as usize;
    let (column, row, plane) = (tiles[group], tiles[group + 1], tiles[group + 2]);
    let depth = depths.near + f32::cast_from(plane) * depths.step;
    let photo_own = photo(views, view);
    let unit = UNIT_POS;
    let half = comptime!(HALF as u32);
    let reach = comptime!(REACH as u32);

    let mut at = unit;
    while at < comptime!((REACH * REACH) as u32) {
        let (x, y) = (column + at % reach, row + at / reach);
        let mut value = f32::new(NOTHING);
        if x >= half && y >= half && x - half < depths.width && y - half < depths.height {
            value = shown(&photo_own, grey, depths.left + x - half, depths.top + y - half);
        }
        own[at as usize] = value;
        at += comptime!(TILE_UNITS as u32);
    }

    let mut best = f32::new(-1.0);
    let mut second = f32::new(-1.0);
    let (tile_x, tile_y) = (unit % comptime!(TILE as u32), unit / comptime!(TILE as u32));
    for index in 0..neighbour_count {
        let photo_other = photo(views, neighbours[index as usize]);
        let carried = Carried::read(carried, index as usize);
        let mut at = unit;
        while at < comptime!((REACH * REACH) as u32) {
            let (x, y) = (column + at % reach, row + at / reach);
            let mut value = f32::new(NOTHING);
            if x >= half && y >= half && x - half < depths.width && y - half < depths.height {
                let place = carried.place(depths.left + x - half, depths.top + y - half, depth);
                value = seen(&photo_other, grey, &place);
            }
            other[at as usize] = value;
            at += comptime!(TILE_UNITS as u32);
        }
        sync_cube();
        add_rows(&own, &other, &mut rows, unit as usize);
        sync_cube();
        let found = correlation(&rows, unit as usize);
        second = second.max(best.min(found));
        best = best.max(found);
    }

    let (x, y) = (column + tile_x, row + tile_y);
    if (CUBE_POS as u32) < count && x < depths.width && y < depths.height {
        let pixel = (y * depths.width + x) as usize;
        if plane >= ranges[2 * pixel] && plane < ranges[2 * pixel + 1] {
            // Patches lie within the picture.
            let is_whole = x >= half && x + half < depths.width;
            let cost = select(is_whole && second > -1.0f32, 1.0f32 - 0.5f32 * (best + second), f32::new(UNKNOWN));
            costs[(starts[pixel] + plane - ranges[2 * pixel]) as usize] = cost;
        }
    }
}
