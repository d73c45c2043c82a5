//! What pixels of known depth say of the nodes of a grid.

use dvr_core::voxel::VoxelGrid;
use glam::Vec3;
use rayon::prelude::*;

use super::plane_sweep::SweptPixel;
use crate::views::TrainingView;

/// How much a pixel of unknown depth counts, beside one of a known depth: it takes the hull for solid.
const UNKNOWN: f32 = 0.1;

/// Views whose votes are counted at the same time.
pub(super) const AT_ONCE: usize = 16;

/// Spacings from node to node along a ray.
const STEP: f32 = 0.5;

/// How many pixels call a node empty or solid; those of nearby nodes count in part.
pub(super) struct Votes {
    pub empty: Vec<f32>,
    pub solid: Vec<f32>,
}

impl Votes {
    fn none(grid: &VoxelGrid) -> Self {
        Self { empty: vec![0.0; grid.len()], solid: vec![0.0; grid.len()] }
    }

    fn join(&mut self, other: &Self) {
        let pairs = [(&mut self.empty, &other.empty), (&mut self.solid, &other.solid)];
        pairs.into_iter().for_each(|(sum, votes)| sum.iter_mut().zip(votes).for_each(|(sum, vote)| *sum += vote));
    }

    /// The votes of all views; a pixel that was looked at stands for `weight` pixels.
    pub fn of(views: &[TrainingView], swept: &[Vec<SweptPixel>], grid: &VoxelGrid, weight: f32) -> Self {
        let of_view = |(view, pixels): (&TrainingView, &Vec<SweptPixel>)| {
            let mut votes = Self::none(grid);
            pixels.iter().for_each(|pixel| votes.add(view.camera.center, pixel, grid, weight));
            votes
        };
        let mut sum = Self::none(grid);
        // A few views at a time, which bounds the memory; one after another, so that sums do not depend on the threads.
        for (views, swept) in views.chunks(AT_ONCE).zip(swept.chunks(AT_ONCE)) {
            for votes in views.par_iter().zip(swept).map(of_view).collect::<Vec<_>>() {
                sum.join(&votes);
            }
        }
        Self { empty: blurred(grid, sum.empty), solid: blurred(grid, sum.solid) }
    }

    /// Adds the votes of a pixel: what lies a spacing before its depth is empty, the spacing behind it solid.
    fn add(&mut self, origin: Vec3, pixel: &SweptPixel, grid: &VoxelGrid, weight: f32) {
        let length = pixel.direction.length();
        let depth = pixel.depth.unwrap_or(pixel.near);
        let weight = if pixel.depth.is_some() { weight } else { UNKNOWN * weight };
        for (z, node) in nodes_along(origin, pixel, grid, depth + grid.spacing() / length) {
            let behind = (z - depth) * length;
            if behind < -grid.spacing() {
                self.empty[node] += weight;
            } else if behind > -0.5 * STEP * grid.spacing() {
                self.solid[node] += weight;
            }
        }
    }
}

/// The nodes nearest to a pixel's ray, from where it enters the hull to a z-depth, each once in a row, with its z-depth.
pub(super) fn nodes_along(
    origin: Vec3,
    pixel: &SweptPixel,
    grid: &VoxelGrid,
    end: f32,
) -> impl Iterator<Item = (f32, usize)> {
    let step = STEP * grid.spacing() / pixel.direction.length();
    let mut last = usize::MAX;
    let along = (0..).map(move |k| pixel.near + k as f32 * step).take_while(move |z| *z < end);
    along.filter_map(move |z| {
        let node = nearest(grid, origin + z * pixel.direction);
        (std::mem::replace(&mut last, node) != node).then_some((z, node))
    })
}

/// The node nearest to a point.
fn nearest(grid: &VoxelGrid, point: Vec3) -> usize {
    let last = (grid.nodes() - 1) as f32;
    // Cut off after half was added: to round as the mathematics library does takes longer than all the rest.
    let at = grid.to_grid(point).clamp(Vec3::ZERO, Vec3::splat(last)) + 0.5;
    grid.index(at.to_array().map(|c| c as u32 as usize))
}

/// Each node's value and half of those beside it, along all three axes: a binomial filter.
pub(super) fn blurred(grid: &VoxelGrid, mut values: Vec<f32>) -> Vec<f32> {
    let last = grid.nodes() - 1;
    for axis in 0..3 {
        let stride = grid.nodes().pow(axis as u32);
        let along = |node: usize| {
            let at = grid.coordinates(node)[axis];
            let (before, after) =
                (if at > 0 { node - stride } else { node }, if at < last { node + stride } else { node });
            0.25 * values[before] + 0.5 * values[node] + 0.25 * values[after]
        };
        values = (0..grid.len()).into_par_iter().map(along).collect();
    }
    values
}
