//! What photographs show to be empty of the visual hull.
//!
//! Gradients of colour lead to a match that is a pixel or two away. The inside of a bowl, which the hull closes, lies ten
//! or twenty pixels behind its start. So before training a plane sweep looks for the depths of pixels, and every one of
//! them votes: what lies before it is empty, what lies at it is solid (space carving: Kutulakos and Seitz 2000, by votes
//! instead of by colour). The solid of least area that agrees with the votes, and explains the silhouettes, is kept; what
//! is empty, leads to the outside, is deep, and is seen by pixels whose way to it is free, is carved away. Training finds
//! the surface from there, and leaves the middle of hollows empty. Where a surface was trained for a look, it may say where
//! the mouths of hollows are.

use dvr_core::voxel::{VoxelGrid, least_area};
use dvr_core::{Cancellation, flood, signed_distance_at_nodes};
use glam::Vec3;
use rayon::prelude::*;

use super::carving_votes::{AT_ONCE, Votes, blurred, nodes_along};
use super::confirmed::forget_unconfirmed;
use super::plane_sweep::{PlaneSweep, SweptPixel};
use super::silhouettes::{unexplained, way};
use crate::accelerator::Accelerator;
use crate::error::Result;
use crate::views::TrainingView;

/// Cells along an edge of the grid that is carved, whatever the first stage has: memory goes by their cube.
pub(crate) const CARVING_CELLS: usize = 64;

/// Bytes of a node of it: votes of the views that are counted at the same time and their sum, and what the cut solves for.
pub(crate) const CARVING_NODE: u64 = 8 * (AT_ONCE as u64 + 1) + 32;

/// How near points of other views confirm a depth, in spacings.
const CONFIRMED: f32 = 1.2;

/// How much a vote for solid counts, beside one for empty: a wall is seen by the few pixels that look at it, and passed by
/// all that match too deep.
const SOLID: f32 = 3.0;

/// Votes that half believe in what they say.
const HALF_SURE: f32 = 3.0;

/// How deep a hollow is at least, in spacings behind the hull: shallower ones are noise, or in reach of the gradients.
const DEEP: f32 = 3.0;

/// Pixels that see a hollow's nodes on a free way, on the mean, at least.
const SEEN: f32 = 0.2;

/// Way through what is solid, in spacings, from which a pixel sees nothing behind it: its depth is wrong.
const BLOCKED: f32 = 2.0;

/// Share of the hull from which what was carved is a hollow, not dents and noise.
const MUCH_CARVED: f64 = 0.2;

/// How far a carved node lies at least from all that may be solid so that it stays empty, in spacings: walls are misplaced
/// by about one.
const STAYS_EMPTY: f32 = 1.2;

/// How deep behind the hull, in spacings, a trained surface says where the mouths of hollows are: about as deep, votes
/// misjudge the walls of what shines.
const SKIN: f32 = 2.5;

/// What is carved out of the hull, as a signed distance at the nodes of a grid, negative in what is carved.
pub(crate) struct SpaceCarving {
    /// Nodes that the votes carved, as a share of those in the hull.
    share: f64,
    grid: VoxelGrid,
    /// Distance to the hull, positive inside.
    hull: Vec<f32>,
    carved: Vec<bool>,
    /// Nodes on rays that the first cut did not explain.
    is_doubted: Vec<bool>,
    values: Vec<f32>,
    /// The same for what is known to be empty: what is carved and on no ray that the first cut did not explain, and all
    /// outside of the hull.
    known_empty: Vec<f32>,
}

impl SpaceCarving {
    /// Sweeps about this many pixels, spread evenly over the views, at the spacing of every second node of `grid`; `hull`
    /// holds the hull's distance at its nodes, positive inside. `None` where nothing is carved. Pixels are looked at on the
    /// accelerator, if it has room.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] where somebody wants it to end, and when a GPU fails.
    pub fn by_plane_sweep(
        views: &[TrainingView],
        grid: &VoxelGrid,
        hull: &[f32],
        pixels: usize,
        accelerator: &mut Accelerator,
        cancellation: &Cancellation,
    ) -> Result<Option<Self>> {
        let coarse = VoxelGrid::new(grid.cells() / 2 + 1, grid.half_extent());
        let hull_of_coarse: Vec<f32> =
            (0..coarse.len()).map(|node| hull[grid.index(coarse.coordinates(node).map(|c| 2 * c))]).collect();
        let sweep = PlaneSweep::new(views, &coarse, cancellation);
        let stride = sweep.stride(pixels);
        let mut swept = sweep.depths(&hull_of_coarse, stride, accelerator)?;
        forget_unconfirmed(views, &mut swept, CONFIRMED * grid.spacing());
        cancellation.check()?;
        let is_inside: Vec<bool> = hull.iter().map(|&distance| distance > 0.0).collect();
        let weight = (stride * stride) as f32;
        let votes = Votes::of(views, &swept, grid, weight);
        let mut price: Vec<f32> =
            votes.empty.iter().zip(&votes.solid).map(|(&empty, &solid)| price(empty, solid)).collect();
        let mut solid = least_area(grid, &price, &is_inside, cancellation)?;
        let mut is_doubted = vec![false; grid.len()];
        let unexplained = unexplained(views, &swept, grid, hull, &solid);
        for &ray in &unexplained {
            way(grid, hull, ray).for_each(|node| is_doubted[node] = true);
        }
        // Something on each of these rays is solid: what costs least.
        let wanted: Vec<usize> = (unexplained.into_iter())
            .filter_map(|ray| way(grid, hull, ray).min_by(|&a, &b| price[a].total_cmp(&price[b])))
            .collect();
        if !wanted.is_empty() {
            wanted.into_iter().for_each(|node| price[node] = -1.0);
            solid = least_area(grid, &price, &is_inside, cancellation)?;
        }
        let seen = Self::seen_through(views, swept, grid, &solid, weight);
        let carved = hollows(grid, hull, &solid, &seen);
        let count = carved.iter().filter(|&&carved| carved).count();
        let share = count as f64 / is_inside.iter().filter(|&&inside| inside).count().max(1) as f64;
        Ok((count > 0).then(|| Self::start(share, *grid, hull.to_vec(), is_doubted).with(carved)))
    }

    /// Nothing carved yet.
    fn start(share: f64, grid: VoxelGrid, hull: Vec<f32>, is_doubted: Vec<bool>) -> Self {
        Self { share, grid, hull, is_doubted, carved: Vec::new(), values: Vec::new(), known_empty: Vec::new() }
    }

    /// A hollow where points are carved, for tests.
    #[cfg(test)]
    pub fn of(grid: VoxelGrid, hull: Vec<f32>, is_carved: impl Fn(Vec3) -> bool) -> Self {
        let carved = (0..grid.len()).map(|node| hull[node] > 0.0 && is_carved(grid.position(node))).collect();
        Self::start(2.0 * MUCH_CARVED, grid, hull, vec![false; grid.len()]).with(carved)
    }

    /// The same where these nodes are carved.
    fn with(self, carved: Vec<bool>) -> Self {
        let is_known = |node: usize| self.hull[node] <= 0.0 || carved[node] && !self.is_doubted[node];
        let known_empty: Vec<bool> = (0..self.grid.len()).map(is_known).collect();
        let known_empty = distances(&self.grid, &known_empty);
        Self { values: distances(&self.grid, &carved), known_empty, carved, ..self }
    }

    /// The same where carved nodes near the hull's surface are solid again that are solid in a field of this value at a
    /// point, positive inside; `None` where then no hollow leads to the outside.
    pub fn with_mouths_of(self, value: impl Fn(Vec3) -> f32) -> Option<Self> {
        let (grid, hull) = (&self.grid, &self.hull);
        let skin = SKIN * grid.spacing();
        let stays = |node: usize| self.carved[node] && (hull[node] > skin || value(grid.position(node)) < 0.0);
        let mut left: Vec<bool> = (0..grid.len()).map(stays).collect();
        let mut carved = vec![false; grid.len()];
        for start in 0..grid.len() {
            if left[start] && grid.neighbours(start).any(|next| hull[next] <= 0.0) {
                flood(start, &mut left, |node| grid.neighbours(node)).into_iter().for_each(|node| carved[node] = true);
            }
        }
        carved.contains(&true).then(|| self.with(carved))
    }

    /// Pixels that call each node empty, of those whose way to their depth is free.
    fn seen_through(
        views: &[TrainingView],
        mut swept: Vec<Vec<SweptPixel>>,
        grid: &VoxelGrid,
        solid: &[bool],
        weight: f32,
    ) -> Vec<f32> {
        let is_free = |origin: Vec3, pixel: &SweptPixel| {
            let Some(depth) = pixel.depth else { return false };
            let length = pixel.direction.length();
            let end = depth - BLOCKED * grid.spacing() / length;
            let mut through = 0.0;
            let mut before = None;
            for (z, node) in nodes_along(origin, pixel, grid, end) {
                through += before.map_or(0.0, |before| (z - before) * length);
                before = solid[node].then_some(z);
            }
            through + before.map_or(0.0, |before| (end - before) * length) < BLOCKED * grid.spacing()
        };
        swept.par_iter_mut().zip(views).for_each(|(pixels, view)| {
            pixels.retain(|pixel| is_free(view.camera.center, pixel));
        });
        Votes::of(views, &swept, grid, weight).empty
    }

    /// Carved nodes, as a share of those in the hull.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Whether a good part of the hull is carved.
    pub fn is_hollow(&self) -> bool {
        self.share > MUCH_CARVED
    }

    /// Whether a point lies so deep in a hollow that no surface can be there. Training closes hollows again
    /// otherwise: noise of the gradients builds a film somewhere that no pixel's gradient takes away, since nothing like it
    /// is seen in other views.
    pub fn stays_empty(&self, point: Vec3) -> bool {
        self.is_hollow()
            && self.at(point) < 0.0
            && self.grid.value(&self.known_empty, point) < -STAYS_EMPTY * self.grid.spacing()
    }

    /// The value at a point; large where nothing is carved nearby.
    pub fn at(&self, point: Vec3) -> f32 {
        self.grid.value(&self.values, point)
    }

    /// The same where walls are a spacing thicker, about as much as votes misplace them: training finds a wall that is too
    /// thick, and loses the outside of one that is too thin.
    pub fn at_thicker_walls(&self, point: Vec3) -> f32 {
        self.at(point) + self.grid.spacing()
    }
}

/// What it costs a node to be solid, from -1 to 1.
fn price(empty: f32, solid: f32) -> f32 {
    (empty - SOLID * solid) / (empty + SOLID * solid + HALF_SURE)
}

/// The nodes of the hull that are not solid, in parts that lead to the outside, are deep, and are seen.
fn hollows(grid: &VoxelGrid, hull: &[f32], solid: &[bool], seen: &[f32]) -> Vec<bool> {
    let is_empty = |node: usize| hull[node] > 0.0 && !solid[node];
    let leads_out = |node: usize| is_empty(node) && grid.neighbours(node).any(|next| hull[next] <= 0.0);
    let (mut carved, mut reached) = (vec![false; grid.len()], vec![false; grid.len()]);
    for start in (0..grid.len()).filter(|&node| leads_out(node)) {
        if std::mem::replace(&mut reached[start], true) {
            continue;
        }
        let mut part = vec![start];
        let mut done = 0;
        while done < part.len() {
            for next in grid.neighbours(part[done]).filter(|&next| is_empty(next)) {
                if !std::mem::replace(&mut reached[next], true) {
                    part.push(next);
                }
            }
            done += 1;
        }
        let deepest = part.iter().map(|&node| hull[node]).fold(0.0, f32::max);
        let mean = part.iter().map(|&node| f64::from(seen[node])).sum::<f64>() / part.len() as f64;
        if deepest > DEEP * grid.spacing() && mean > f64::from(SEEN) {
            part.into_iter().for_each(|node| carved[node] = true);
        }
    }
    carved
}

/// Distance to what is carved, negative inside it.
fn distances(grid: &VoxelGrid, carved: &[bool]) -> Vec<f32> {
    let distances = signed_distance_at_nodes(carved, grid);
    blurred(grid, distances.into_iter().map(|distance| -distance * grid.spacing()).collect())
}

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
        [0.06, -0.15].map(|y| field.logit_at(turn * Vec3::new(0.0, y, 0.0)))
    }

    #[test]
    fn mouths_are_where_the_surface_has_them_and_what_is_deep_stays_carved() {
        let grid = VoxelGrid::new(17, 8.0);
        let hull: Vec<f32> = (0..grid.len()).map(|node| 6.5 - grid.position(node).abs().max_element()).collect();
        // A hollow with a mouth on top and a hole in its wall along x, each three nodes wide.
        let is_carved = |at: Vec3| {
            let is_hollow = at.abs().max_element() < 2.5;
            let leads = |along: f32, [s, t]: [f32; 2]| along > 0.0 && along < 6.5 && s.abs().max(t.abs()) < 1.5;
            is_hollow || leads(at.z, [at.x, at.y]) || leads(at.x, [at.y, at.z])
        };
        let carving = SpaceCarving::of(grid, hull, is_carved);
        let value = |carving: &SpaceCarving, at: [f32; 3]| carving.at(at.into());
        let (mouth, hole, hollow) = ([0.0, 0.0, 5.0], [5.0, 0.0, 0.0], [0.0; 3]);
        assert!([mouth, hole, hollow].iter().all(|&at| value(&carving, at) < 0.0));
        // Training has closed the hole, and filled what no pixel sees of the hollow.
        let carving = carving.with_mouths_of(|at| if at.z > 3.0 { -1.0 } else { 1.0 }).unwrap();
        assert!(value(&carving, mouth) < 0.0 && value(&carving, hollow) < 0.0);
        assert!(value(&carving, hole) > 0.0, "{}", value(&carving, hole));
        assert!(carving.stays_empty(Vec3::ZERO) && !carving.stays_empty(hole.into()));
        assert!(carving.with_mouths_of(|_| 1.0).is_none(), "a void that nothing leads to");
    }

    #[test]
    fn a_part_is_carved_that_leads_out_is_deep_and_is_seen() {
        let grid = VoxelGrid::new(17, 8.0);
        let hull: Vec<f32> = (0..grid.len()).map(|node| 6.5 - grid.position(node).abs().max_element()).collect();
        let is_bore = |node: usize, x: f32, bottom: f32| {
            let at = grid.position(node);
            (at.x - x).abs() < 1.5 && at.y.abs() < 1.5 && at.z > bottom
        };
        let (seen_bore, other_bore) = (|node| is_bore(node, 4.0, 0.0), |node| is_bore(node, -4.0, 0.0));
        let (dent, void) =
            (|node| is_bore(node, 0.0, 4.5), |node| is_bore(node, 0.0, -2.0) && !is_bore(node, 0.0, 2.0));
        let solid: Vec<bool> = (0..grid.len())
            .map(|node| hull[node] > 0.0 && !(seen_bore(node) || other_bore(node) || dent(node) || void(node)))
            .collect();
        let seen: Vec<f32> = (0..grid.len()).map(|node| if other_bore(node) { 0.0 } else { 1.0 }).collect();
        let carved = hollows(&grid, &hull, &solid, &seen);
        for node in 0..grid.len() {
            assert_eq!(carved[node], seen_bore(node) && hull[node] > 0.0, "{}", grid.position(node));
        }
        let distances = distances(&grid, &carved);
        let value = |z| grid.value(&distances, Vec3::new(4.0, 0.0, z));
        assert!(value(4.0) < -0.5 && value(-3.0) > 2.5, "{} in the bore, {} under it", value(4.0), value(-3.0));
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
