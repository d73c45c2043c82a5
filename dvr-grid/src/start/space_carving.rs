//! What photographs show to be empty of the visual hull.
//!
//! Gradients of colour lead to a match that is a pixel or two away. The inside of a bowl, which the hull closes, lies ten
//! or twenty pixels behind its start. So before training a plane sweep looks for the depths of pixels, and every one of
//! them votes: what lies before it is empty, what lies at it is solid. Nodes of a coarse grid that most votes call empty,
//! and that lead to the outside, are carved away (space carving: Kutulakos and Seitz 2000, by votes instead of by
//! colour); training finds the surface from there.

use dvr_core::voxel::VoxelGrid;
use dvr_core::{Cancellation, Cancelled};
use glam::Vec3;
use rayon::prelude::*;

use super::plane_sweep::{PlaneSweep, SweptPixel};
use crate::views::TrainingView;

/// How much a pixel of unknown depth counts, beside one of a known depth: it takes the hull for solid.
const UNKNOWN: f32 = 0.1;

/// Votes for empty, per vote for solid, from which a node is empty. Two matches in five inside the demo's mug are wrong,
/// and what lies too near calls empty nodes solid.
const EMPTY: f32 = 1.3;

/// Fewest votes for empty, in pixels as wide as half a spacing.
const LEAST: f32 = 1.0;

/// Views whose votes are counted at the same time.
const AT_ONCE: usize = 16;

/// What is carved out of the hull, as a distance-like value at the nodes of a coarse grid: negative where nothing is.
pub(crate) struct SpaceCarving {
    /// Carved nodes, as a share of those in the hull.
    pub share: f64,
    grid: VoxelGrid,
    values: Vec<f32>,
}

impl SpaceCarving {
    /// Sweeps about this many pixels, spread evenly over the views; `hull` holds the hull's distance at the nodes of
    /// `grid`, positive inside. `None` where nothing is carved.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn by_plane_sweep(
        views: &[TrainingView],
        grid: &VoxelGrid,
        hull: &[f32],
        pixels: usize,
        cancellation: &Cancellation,
    ) -> Result<Option<Self>, Cancelled> {
        let sweep = PlaneSweep::new(views, grid, cancellation);
        let stride = sweep.stride(pixels);
        let swept = sweep.depths(hull, stride)?;
        let votes = Votes::of(views, &swept, grid, (stride * stride) as f32);
        cancellation.check()?;
        let is_empty: Vec<bool> = (0..grid.len()).map(|node| hull[node] > 0.0 && votes.say_empty(node)).collect();
        let carved = reachable(grid, hull, &is_empty);
        let count = carved.iter().filter(|&&carved| carved).count();
        let share = count as f64 / hull.iter().filter(|&&distance| distance > 0.0).count().max(1) as f64;
        Ok((count > 0).then(|| Self { share, grid: *grid, values: smoothed(grid, &carved) }))
    }

    /// The value at a point; large where nothing is carved nearby.
    pub fn at(&self, point: Vec3) -> f32 {
        self.grid.value(&self.values, point)
    }
}

/// How many pixels call a node empty or solid; those of nearby nodes count in part.
struct Votes {
    empty: Vec<f32>,
    solid: Vec<f32>,
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
    fn of(views: &[TrainingView], swept: &[Vec<SweptPixel>], grid: &VoxelGrid, weight: f32) -> Self {
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

    /// Adds the votes of a pixel: a spacing before its depth is empty, a spacing behind it solid.
    fn add(&mut self, origin: Vec3, pixel: &SweptPixel, grid: &VoxelGrid, weight: f32) {
        let step = 0.5 * grid.spacing();
        let depth = pixel.depth.unwrap_or(pixel.near);
        let weight = if pixel.depth.is_some() { weight } else { UNKNOWN * weight };
        let mut last = usize::MAX;
        let along = (0..).map(|k| pixel.near + k as f32 * step / pixel.direction.length());
        for z in along.take_while(|z| *z < depth + grid.spacing()) {
            let node = nearest(grid, origin + z * pixel.direction);
            if node == last {
                continue;
            }
            last = node;
            if z < depth - grid.spacing() {
                self.empty[node] += weight;
            } else if z > depth - 0.5 * step {
                self.solid[node] += weight;
            }
        }
    }

    /// Whether a node is empty by most votes.
    fn say_empty(&self, node: usize) -> bool {
        self.empty[node] > LEAST && self.empty[node] > EMPTY * self.solid[node]
    }
}

/// The node nearest to a point.
fn nearest(grid: &VoxelGrid, point: Vec3) -> usize {
    let last = (grid.nodes() - 1) as f32;
    let at = grid.to_grid(point).round().clamp(Vec3::ZERO, Vec3::splat(last));
    grid.index(at.to_array().map(|c| c as usize))
}

/// Each node's value and half of those beside it, along all three axes: a binomial filter.
fn blurred(grid: &VoxelGrid, mut values: Vec<f32>) -> Vec<f32> {
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

/// The empty nodes of the hull that lead to the outside by others of their kind.
fn reachable(grid: &VoxelGrid, hull: &[f32], is_empty: &[bool]) -> Vec<bool> {
    let last = grid.nodes() - 1;
    let beside = |node: usize| {
        let at = grid.coordinates(node);
        (0..6).filter_map(move |i| {
            let mut next = at;
            next[i / 2] = if i % 2 == 0 { at[i / 2].checked_sub(1)? } else { at[i / 2] + 1 };
            (next[i / 2] <= last).then(|| grid.index(next))
        })
    };
    let mut carved = vec![false; grid.len()];
    let mut border: Vec<usize> =
        (0..grid.len()).filter(|&node| is_empty[node] && beside(node).any(|next| hull[next] <= 0.0)).collect();
    border.iter().for_each(|&node| carved[node] = true);
    while let Some(node) = border.pop() {
        for next in beside(node).filter(|&next| is_empty[next]) {
            if !std::mem::replace(&mut carved[next], true) {
                border.push(next);
            }
        }
    }
    carved
}

/// A value that passes through zero half way between what is carved and what is not, one spacing to both sides, and
/// is large farther in.
fn smoothed(grid: &VoxelGrid, carved: &[bool]) -> Vec<f32> {
    let (last, spacing) = (grid.nodes() - 1, grid.spacing());
    let around = |c: usize| c.saturating_sub(1)..=(c + 1).min(last);
    (0..grid.len())
        .into_par_iter()
        .map(|node| {
            let [x, y, z] = grid.coordinates(node);
            let (mut solid, mut all) = (0, 0);
            for (z, y) in around(z).flat_map(|z| around(y).map(move |y| (z, y))) {
                for x in around(x) {
                    solid += usize::from(!carved[grid.index([x, y, z])]);
                    all += 1;
                }
            }
            if solid == all { FAR * spacing } else { (2.0 * solid as f32 / all as f32 - 1.0) * spacing }
        })
        .collect()
}

/// Spacings that stand for far away from what is carved.
const FAR: f32 = 3.0;

#[cfg(test)]
mod tests {
    use dvr_core::dataset::{ReadOptions, read_scene};
    use dvr_stress::{axes, write_scene};
    use glam::{EulerRot, Quat};

    use crate::config::GridConfig;
    use crate::trainer::GridTrainer;

    use super::*;

    /// Values of the field that training starts from, in a bowl half as deep as wide: in its hollow, and in its floor.
    fn start(axis: &str, difficulty: f64, plane_sweep_pixels: usize) -> [f32; 2] {
        let case = axes().into_iter().find(|found| found.name == axis).and_then(|axis| axis.case(difficulty)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let scene = write_scene(&case, "bowl", 0, folder.path()).unwrap();
        let scene = read_scene(&scene, &ReadOptions::default()).unwrap();
        let config = GridConfig { plane_sweep_pixels, ..GridConfig::default() };
        let trainer = GridTrainer::new(scene.views.iter().collect(), Vec::new(), config).unwrap();
        let field = trainer.field().unwrap();
        // The bowl's axis is y, turned like this; its rim is at .18, its floor between -.18 and -.1.
        let turn = Quat::from_euler(EulerRot::XYZ, 0.5, 0.3, 0.2);
        let shape = field.shape();
        [0.06, -0.15].map(|y| shape.grid.value(&shape.values, turn * Vec3::new(0.0, y, 0.0)))
    }

    #[test]
    fn the_inside_of_a_bowl_is_carved_where_photographs_show_it_and_nowhere_else() {
        let [hollow, floor] = start("texture-contrast", 1.0, 0);
        assert!(hollow > 0.0 && floor > 0.0, "the hull closes the bowl: {hollow}");
        let [hollow, floor] = start("texture-contrast", 1.0, 250_000);
        assert!(hollow < 0.0 && floor > 0.0, "{hollow} in the hollow, {floor} in the floor");
        let [_, floor] = start("texture-contrast", 0.0, 250_000);
        assert!(floor > 0.0, "without texture, by shading alone: {floor} in the floor");
    }
}
