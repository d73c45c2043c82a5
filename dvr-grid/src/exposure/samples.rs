//! Points of the surface as pairs of photographs show them.

use dvr_core::Exposure;
use glam::Vec3;
use rayon::prelude::*;

use crate::bricks::{BrickOccupancy, BrickValues};
use crate::config::GridConfig;
use crate::pixel_order::{PixelOrder, mix};
use crate::step::draw::{DrawnRay, draw};
use crate::surface::Surface;
use crate::views::TrainingView;

/// Pixels that are asked.
const PIXELS: u64 = 8192;

/// Views that each is compared with, at most: its nearest.
const COMPARED: usize = 6;

/// Edge of the blocks of space that are taken for independent of each other, in edges of the object cube.
const BLOCK: f32 = 1.0 / 6.0;

/// What two views show of a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub views: [u32; 2],
    /// Which part of the surface the point is on.
    pub block: u64,
    /// How much brighter the second view shows it than the first, as differences of logarithms of its channels, not
    /// corrected; NaN where one is dark or burnt.
    pub logs: [f64; 3],
}

/// Pairs of colours at the pixels that come after `rays_drawn`.
pub(super) fn samples(
    shape: &BrickValues<1>,
    views: &[TrainingView],
    order: &PixelOrder,
    config: &GridConfig,
    rays_drawn: u64,
) -> Vec<Sample> {
    let occupancy = BrickOccupancy::new(shape);
    let surface = Surface::of(shape, &occupancy);
    let of_pixel = |count: u64| {
        let DrawnRay { view, pixel, .. } = draw(order, config.seed, rays_drawn + count);
        of_pixel(&surface, views, view, pixel)
    };
    let found: Vec<Vec<Sample>> = (0..PIXELS).into_par_iter().map(of_pixel).collect();
    found.concat()
}

/// What the neighbours of a view show at the hit of one of its pixels.
fn of_pixel(surface: &Surface, views: &[TrainingView], view: u32, pixel: u32) -> Vec<Sample> {
    let own = &views[view as usize];
    let ray = own.pixel_ray(view, pixel);
    // Pixels at the outline are part background.
    if !own.is_interior(ray.pixel) {
        return Vec::new();
    }
    let Some(at) = surface.hit(own, ray.direction).filter(|at| surface.faces(at, own)) else { return Vec::new() };
    let block = (at.point / BLOCK).floor();
    let block = [block.x, block.y, block.z].into_iter().fold(0, |hash, at| mix(hash ^ (at as i64 as u64)));
    let logs_of_own = logs(own.exposure, ray.color);
    let sample = |&other: &u32| {
        let seen = views[other as usize].reproject(at.point, ray.direction)?;
        if !surface.is_seen_by(&at, &views[other as usize]) {
            return None;
        }
        let logs = logs(views[other as usize].exposure, seen.color);
        let sample = Sample { views: [view, other], block, logs: [0, 1, 2].map(|c| logs[c] - logs_of_own[c]) };
        sample.logs.iter().any(|log| log.is_finite()).then_some(sample)
    };
    own.neighbours.iter().take(COMPARED).filter_map(sample).collect()
}

/// Logarithms of the channels of a photograph, given their colour at the mean exposure.
fn logs(exposure: Exposure, corrected: Vec3) -> [f64; 3] {
    let shown = exposure.photographed(corrected.to_array());
    shown.map(|level| if Exposure::is_usable(level) { Exposure::log(level) } else { f64::NAN })
}
