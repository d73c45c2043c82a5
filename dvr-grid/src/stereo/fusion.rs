//! Depth maps of many views as one distance field.

use dvr_core::Bilinear;
use dvr_core::voxel::VoxelGrid;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::depth_map::DepthMap;
use super::hull::Hull;
use super::picture::Picture;

/// Distances count up to this many spacings.
const TRUNCATION: f32 = 4.0;

/// How much a view counts where it sees through a node that lies far before its surface: less than one that sees the
/// surface, since pixels at outlines show what is behind.
const FREE_WEIGHT: f32 = 0.1;

/// Least weight of a surface seen edge-on, and that of one whose slope is not known.
const LEAST_FACING: f32 = 0.02;
const UNKNOWN_FACING: f32 = 0.05;

/// Pixels' footprints that depths of one surface differ by, at most, between neighbours.
const MAX_STEP: f32 = 6.0;

/// How much the hull counts against a view that is sure.
const HULL_WEIGHT: f32 = 0.1;

/// A truncated signed distance, positive inside; no number where no view says anything.
pub(crate) struct FusedDistance {
    grid: VoxelGrid,
    values: Vec<f32>,
    weights: Vec<f32>,
}

impl FusedDistance {
    /// Fuses depth maps on the nodes of a grid (Curless and Levoy 1996): the mean over views of how far a node lies
    /// behind the depth there, weighted by confidence. What lies further behind is not known to a view; what lies before
    /// is free. Nothing is asked where the `hull` is further away than distances count. `None` where there is no depth at all.
    pub(super) fn new(pictures: &[Picture], maps: &[DepthMap], grid: &VoxelGrid, hull: &Hull) -> Option<Self> {
        let truncation = TRUNCATION * grid.spacing();
        let facing: Vec<Vec<f32>> = pictures.par_iter().zip(maps).map(|(picture, map)| facing(picture, map)).collect();
        let node = |node: usize| {
            let point = grid.position(node);
            let (mut sum, mut total) = (0.0, 0.0);
            if hull.at(point) < -truncation {
                return [f32::NAN, 0.0];
            }
            for ((picture, map), facing) in pictures.iter().zip(maps).zip(&facing) {
                let (place, z) = picture.camera.project(point);
                if z <= 0.0 {
                    continue;
                }
                let Some(pixel) = picture.pixel_at(place) else { continue };
                // Depths that are interpolated are no further from that of the pixel.
                let doubt = 1.001 * MAX_STEP * picture.camera.footprint();
                if map.z_depth[pixel].is_nan() || z - map.z_depth[pixel] > truncation + doubt {
                    continue;
                }
                let depth = interpolated(picture, map, place).unwrap_or(map.z_depth[pixel]);
                let behind = z - depth;
                if behind < truncation {
                    let free = if behind < -truncation { FREE_WEIGHT } else { 1.0 };
                    let weight = map.confidence[pixel] * facing[pixel] * free;
                    sum += weight * behind.max(-truncation);
                    total += weight;
                }
            }
            [if total > 0.0 { sum / total } else { f32::NAN }, total]
        };
        let (values, weights): (Vec<f32>, Vec<f32>) =
            (0..grid.len()).into_par_iter().map(node).map(|[value, weight]| (value, weight)).unzip();
        let is_known = weights.iter().any(|&weight| weight > 0.0);
        is_known.then_some(Self { grid: *grid, values, weights })
    }

    /// Distance at a point, positive inside, as far as the views that see it agree: blended with `hull`, the hull's,
    /// where they say little.
    pub fn at(&self, point: Vec3, hull: f32) -> f32 {
        let cell = self.grid.locate(point);
        let (mut sum, mut total) = (0.0, 0.0);
        for (weight, offset) in cell.weights().into_iter().zip(self.grid.corner_offsets()) {
            let (value, known) = (self.values[cell.node + offset], self.weights[cell.node + offset]);
            if !value.is_nan() {
                sum += weight * known * value;
                total += weight * known;
            }
        }
        let limit = TRUNCATION * self.grid.spacing();
        let hull = hull.clamp(-limit, limit);
        (sum + HULL_WEIGHT * hull) / (total + HULL_WEIGHT)
    }
}

/// How well the surface that a depth map shows faces its camera, per pixel: a power of the cosine. Little where it is
/// not known, at the borders of what is.
fn facing(picture: &Picture, map: &DepthMap) -> Vec<f32> {
    let (width, height) = (picture.width, picture.height);
    let point = |x: usize, y: usize| {
        let pixel = y * width + x;
        picture.camera.center + map.z_depth[pixel] * picture.direction(pixel)
    };
    (0..width * height)
        .map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            if map.z_depth[pixel].is_nan() || x == 0 || y == 0 || x + 1 == width || y + 1 == height {
                return UNKNOWN_FACING;
            }
            let (across, down) = (point(x + 1, y) - point(x - 1, y), point(x, y + 1) - point(x, y - 1));
            let normal = across.cross(down);
            let cosine = normal.normalize_or_zero().dot(picture.direction(pixel).normalize()).abs();
            if cosine.is_nan() { UNKNOWN_FACING } else { (cosine * cosine).max(LEAST_FACING) }
        })
        .collect()
}

/// The depth between four pixels that belong to one surface.
fn interpolated(picture: &Picture, map: &DepthMap, place: Vec2) -> Option<f32> {
    let at = Bilinear::at_single(place, (picture.width as u32, picture.height as u32))?;
    let depths = at.pixels.map(|(u, v)| map.z_depth[v as usize * picture.width + u as usize]);
    let (low, high) = depths.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &d| (l.min(d), h.max(d)));
    (depths.iter().all(|d| d.is_finite()) && high - low < MAX_STEP * picture.camera.footprint())
        .then(|| at.value(depths))
}
