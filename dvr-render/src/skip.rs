//! Empty space that need not be marched: a coarse grid of cells that may hold surface.

use dvr_core::voxel::{VoxelGrid, VoxelTraversal};
use dvr_core::{Ray, UnitCube};
use glam::Vec3;
use rayon::prelude::*;

use crate::chunks::chunks;
use crate::extract::ScalarField;

/// Cells of the padded cube, each marked if the object may be in it or beside it.
///
/// A cell is marked when one of its eight corners is inside, and so are its 26 neighbours. What is missed is therefore
/// bounded: only a part of the object that contains no corner of the grid and is more than a cell away from any corner
/// that is inside. Nothing thicker than a cell's diagonal can be.
#[derive(Clone, Debug)]
pub struct SkipGrid {
    cube: UnitCube,
    cells: usize,
    marked: Vec<bool>,
}

/// Corners that are asked for at once: enough to keep a GPU busy.
const POINTS: usize = 1 << 16;

impl SkipGrid {
    /// Asks the field at the `(cells + 1)^3` corners.
    pub fn build(field: &(impl ScalarField + ?Sized), cube: UnitCube, cells: usize) -> Self {
        let nodes = cells + 1;
        let half = cube.half_extent() as f32;
        let step = 2.0 * half / cells as f32;
        let coordinate = |i: usize| i as f32 * step - half;
        let node = |i: usize| Vec3::from_array([i / (nodes * nodes), i / nodes % nodes, i % nodes].map(coordinate));
        let mut inside = Vec::with_capacity(nodes * nodes * nodes);
        for (start, length) in chunks(nodes * nodes * nodes, POINTS) {
            let points: Vec<_> = (start..start + length).map(node).collect();
            inside.extend(field.logits(&points).into_iter().map(|logit| logit >= 0.0));
        }
        Self::of_cells(cube, cells, |[x, y, z]| any_corner_inside(&inside, nodes, [x, y, z]))
    }

    /// Marks the cells `[x, y, z]`, each below `cells`, for which `may_hold` is true, and their 26 neighbours.
    pub fn of_cells(cube: UnitCube, cells: usize, may_hold: impl Fn([usize; 3]) -> bool + Sync) -> Self {
        let own: Vec<bool> = (0..cells * cells * cells)
            .into_par_iter()
            .map(|i| may_hold([i / (cells * cells), i / cells % cells, i % cells]))
            .collect();
        Self { cube, cells, marked: dilated(&own, cells) }
    }

    /// Ray depths between which the ray may meet the object, within the cube; `None` where it cannot.
    pub fn interval(&self, ray: &Ray) -> Option<(f64, f64)> {
        let grid = VoxelGrid::new(self.cells + 1, self.cube.half_extent() as f32);
        let walk = VoxelTraversal::new(&grid, ray.origin.as_vec3(), ray.direction.as_vec3(), 0.0, f32::INFINITY)?;
        let marked = walk.filter(|segment| {
            let [x, y, z] = segment.cell;
            self.marked[(x * self.cells + y) * self.cells + z]
        });
        marked.fold(None, |found: Option<(f64, f64)>, segment| {
            let first = found.map_or(f64::from(segment.enter), |(first, _)| first);
            Some((first, f64::from(segment.leave)))
        })
    }

    /// Share of the cells that are marked.
    pub fn filled(&self) -> f64 {
        self.marked.iter().filter(|&&m| m).count() as f64 / self.marked.len().max(1) as f64
    }
}

/// Whether one of a cell's eight corners is inside.
fn any_corner_inside(inside: &[bool], nodes: usize, [x, y, z]: [usize; 3]) -> bool {
    let corner = |dx, dy, dz| inside[((x + dx) * nodes + y + dy) * nodes + z + dz];
    (0..8).any(|c| corner(c >> 2, c >> 1 & 1, c & 1))
}

/// Marks the 26 neighbours of each marked cell, one axis after the other.
fn dilated(cells: &[bool], n: usize) -> Vec<bool> {
    let mut current = cells.to_vec();
    for stride in [1, n, n * n] {
        let before = current.clone();
        current.par_iter_mut().enumerate().for_each(|(i, cell)| {
            let at = i / stride % n;
            *cell |= (at > 0 && before[i - stride]) || (at + 1 < n && before[i + stride]);
        });
    }
    current
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn grid() -> SkipGrid {
        // A ball of radius 0.2 around (0.1, 0, 0).
        let ball = |points: &[Vec3]| points.iter().map(|p| 0.2 - p.distance(Vec3::X * 0.1)).collect::<Vec<_>>();
        SkipGrid::build(&ball, UnitCube::default(), 22)
    }

    #[test]
    fn the_interval_of_a_ray_that_hits_holds_the_ball_and_little_more() {
        for direction in [DVec3::X, DVec3::NEG_Y, DVec3::new(0.3, -0.5, 0.7), DVec3::new(1.0, 1.0, 1.0)] {
            let center = DVec3::new(0.1, 0.0, 0.0);
            let ray = Ray { origin: center - 2.0 * direction, direction };
            let (entry, exit) = grid().interval(&ray).unwrap();
            let radius = 0.2 / direction.length();
            let slack = 3.0 * 0.05 * 3f64.sqrt() / direction.length();
            assert!(entry <= 2.0 - radius && entry > 2.0 - radius - slack, "{direction}: {entry}");
            assert!(exit >= 2.0 + radius && exit < 2.0 + radius + slack, "{direction}: {exit}");
        }
    }

    #[test]
    fn a_ray_far_from_the_ball_has_no_interval() {
        let ray = Ray { origin: DVec3::new(-0.45, -2.0, 0.0), direction: DVec3::Y };
        assert_eq!(grid().interval(&ray), None);
        let away = Ray { origin: DVec3::new(0.0, -2.0, 0.0), direction: DVec3::NEG_Y };
        assert_eq!(grid().interval(&away), None);
    }

    #[test]
    fn a_ray_that_starts_in_the_ball_has_an_interval_from_its_origin() {
        let ray = Ray { origin: DVec3::new(0.1, 0.0, 0.0), direction: DVec3::Z };
        assert_eq!(grid().interval(&ray).map(|(entry, _)| entry), Some(0.0));
    }
}
