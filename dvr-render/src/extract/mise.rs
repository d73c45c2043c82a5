//! Multi-resolution isosurface extraction: the field is evaluated densely on a coarse grid, and on finer grids only
//! where the surface is (Mescheder et al. 2019, section 3.3, with the surface tracked so that it cannot be cut).
//!
//! Each level halves the cells. A level starts from the cells where its parent saw the surface and *floods*: whenever
//! the surface leaves a visited cell through a face, the cell beyond is visited too. So a component that was met
//! anywhere is followed to its end, and is the one that dense marching cubes would give.
//!
//! Where a level starts:
//! - the first from all children of the coarse cells that the surface meets, and of the ring of cells around them;
//! - those between from all children of the parent's cells, which finds detail that the parent was too coarse for;
//! - the last, which costs the most, only from the halves of the parent's crossed edges that are crossed.

use glam::{UVec3, Vec3};

use super::error::{ExtractError, Result};
use super::grid::{GridGeometry, Slot, SparseGrid};
use super::marching_cubes::{FACE_CORNERS, case, corner_offset, edge_axis, edge_start};
use super::sampler::Sampler;
use crate::field::scalar::ScalarField;

/// The finest grid, with every cell that the surface passes through.
pub(super) struct Located {
    pub grid: SparseGrid,
    /// Cells an edge of the coarsest grid that showed the surface, if that was not the coarse grid itself.
    pub first_seen_at: Option<usize>,
}

/// Finds the surface on the grid that results from halving the cells of `coarse` `steps` times.
///
/// `seeds` are points on or near the surface: parts that the coarse grid misses are found through them. If nothing at
/// all is found, the finer grids are searched densely, coarse to fine, so that an empty answer is never an accident.
///
/// # Errors
/// No surface, or unsound answers of the field.
pub(super) fn locate_surface<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    coarse: GridGeometry,
    steps: usize,
    seeds: &[Vec3],
) -> Result<Located> {
    let root = dense_grid(sampler, coarse)?;
    let mut refined = None;
    let mut first_seen_at = None;
    if sampler.has_seen_both_sides() || !seeds.is_empty() {
        refined = descend(sampler, &root, steps, seeds)?;
    }
    let mut geometry = coarse;
    while !sampler.has_seen_both_sides() && geometry.cells < coarse.cells << steps {
        geometry = geometry.refined();
        let mut found = scan(sampler, geometry)?;
        if !found.is_empty() {
            first_seen_at = Some(geometry.cells as usize);
            found.extend_from_slice(seeds);
            refined = descend(sampler, &root, steps, &found)?;
        }
    }
    let grid = refined.unwrap_or(root);
    if sampler.has_seen_both_sides() && grid.has_active_cells() {
        return Ok(Located { grid, first_seen_at });
    }
    Err(ExtractError::NoSurface {
        inside: sampler.range.0 >= sampler.level,
        level: sampler.level,
        min: sampler.range.0,
        max: sampler.range.1,
        resolution: (coarse.cells as usize) << steps,
        evaluations: sampler.evaluations,
    })
}

/// A grid with all nodes evaluated, and all cells that the surface passes through marked.
fn dense_grid<F: ScalarField + ?Sized>(sampler: &mut Sampler<F>, geometry: GridGeometry) -> Result<SparseGrid> {
    let mut level = Level::new(geometry, None);
    for node in box_indices(UVec3::ZERO, UVec3::splat(geometry.padded_cells() + 1)) {
        level.request(sampler, node)?;
    }
    level.evaluate_pending(sampler)?;
    for cell in box_indices(UVec3::ZERO, UVec3::splat(geometry.padded_cells())) {
        if !matches!(level.grid.inside_corners(cell), 0 | 255) {
            level.grid.mark_active(cell);
        }
    }
    Ok(level.grid)
}

/// The nodes of a grid, those of its parent left out, whose sign is not that of all nodes seen before.
fn scan<F: ScalarField + ?Sized>(sampler: &mut Sampler<F>, geometry: GridGeometry) -> Result<Vec<Vec3>> {
    let was_inside = sampler.range.0 >= sampler.level;
    let mut found = Vec::new();
    let max_points = sampler.max_points;
    let mut batch = Vec::new();
    let mut flush = |batch: &mut Vec<Vec3>| -> Result<()> {
        let values = sampler.values(batch)?;
        found.extend(batch.iter().zip(values).filter(|&(_, value)| (value >= 0.0) != was_inside).map(|(&p, _)| p));
        batch.clear();
        Ok(())
    };
    // Real nodes are counted from 1, so the parent's are those with odd indices only.
    let nodes = box_indices(UVec3::ONE, UVec3::splat(geometry.cells + 2));
    for node in nodes.filter(|node| node.x & node.y & node.z & 1 == 0) {
        batch.push(geometry.point(node, 0, 0.0));
        if batch.len() == max_points {
            flush(&mut batch)?;
        }
    }
    flush(&mut batch)?;
    Ok(found)
}

/// Refines a dense grid level by level along the surface; `None` if there are no steps to take.
fn descend<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    root: &SparseGrid,
    steps: usize,
    seeds: &[Vec3],
) -> Result<Option<SparseGrid>> {
    let mut parent: Option<SparseGrid> = None;
    for step in 1..=steps {
        let coarse = parent.as_ref().unwrap_or(root);
        let mut level = Level::new(coarse.geometry.refined(), Some(coarse));
        if step == 1 {
            level.visit_children(sampler, coarse, 1)?;
        } else if step < steps {
            level.visit_children(sampler, coarse, 0)?;
        } else {
            level.visit_crossed_halves(sampler, coarse)?;
        }
        level.flood(sampler)?;
        level.visit_seeds(sampler, seeds)?;
        parent = Some(level.grid);
    }
    Ok(parent)
}

/// One grid while its cells are being visited.
struct Level<'a> {
    grid: SparseGrid,
    /// The grid of twice the cell size, whose values are not evaluated again.
    parent: Option<&'a SparseGrid>,
    /// Cells visited but not yet looked at.
    frontier: Vec<UVec3>,
    /// Nodes to be evaluated in the next batch.
    pending: Vec<Slot>,
}

impl<'a> Level<'a> {
    fn new(geometry: GridGeometry, parent: Option<&'a SparseGrid>) -> Self {
        Self { grid: SparseGrid::new(geometry), parent, frontier: Vec::new(), pending: Vec::new() }
    }

    /// Has a node evaluated sooner or later, once.
    fn request<F: ScalarField + ?Sized>(&mut self, sampler: &mut Sampler<F>, node: UVec3) -> Result<()> {
        let slot = self.grid.slot(node);
        if !self.grid.mark_requested(slot) {
            return Ok(());
        }
        if self.grid.geometry.is_virtual(node) {
            self.grid.set_value(slot, f32::MIN);
            return Ok(());
        }
        // Real nodes with odd indices lie on the parent's nodes.
        let shared = node.x & node.y & node.z & 1 == 1;
        let known = self.parent.filter(|_| shared).and_then(|parent| parent.known_value((node + 1) / 2));
        match known {
            Some(value) => self.grid.set_value(slot, value),
            None => {
                self.pending.push(slot);
                if self.pending.len() == sampler.max_points {
                    self.evaluate_pending(sampler)?;
                }
            }
        }
        Ok(())
    }

    fn evaluate_pending<F: ScalarField + ?Sized>(&mut self, sampler: &mut Sampler<F>) -> Result<()> {
        let geometry = self.grid.geometry;
        let points: Vec<Vec3> = self.pending.iter().map(|&slot| geometry.point(self.grid.node(slot), 0, 0.0)).collect();
        for (slot, value) in self.pending.drain(..).zip(sampler.values(&points)?) {
            self.grid.set_value(slot, value);
        }
        Ok(())
    }

    /// Puts a cell on the frontier, once.
    fn visit<F: ScalarField + ?Sized>(&mut self, sampler: &mut Sampler<F>, cell: UVec3) -> Result<()> {
        if self.grid.mark_visited(cell) {
            for corner in 0..8 {
                self.request(sampler, cell + corner_offset(corner))?;
            }
            self.frontier.push(cell);
        }
        Ok(())
    }

    /// Follows the surface from the cells on the frontier until it has left none of the visited cells unanswered.
    fn flood<F: ScalarField + ?Sized>(&mut self, sampler: &mut Sampler<F>) -> Result<()> {
        while !self.frontier.is_empty() {
            self.evaluate_pending(sampler)?;
            for cell in std::mem::take(&mut self.frontier) {
                let inside = self.grid.inside_corners(cell);
                if matches!(inside, 0 | 255) {
                    continue;
                }
                self.grid.mark_active(cell);
                for (face, corners) in FACE_CORNERS.into_iter().enumerate() {
                    if inside & corners != 0 && inside & corners != corners {
                        // The virtual layer is wholly outside: a face with both signs has a cell beyond it.
                        let axis = UVec3::AXES[face / 2];
                        self.visit(sampler, if face % 2 == 0 { cell - axis } else { cell + axis })?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Visits all children of the parent's cells on the surface, and of the cells up to `ring` away from them.
    fn visit_children<F: ScalarField + ?Sized>(
        &mut self,
        sampler: &mut Sampler<F>,
        parent: &SparseGrid,
        ring: u32,
    ) -> Result<()> {
        let geometry = parent.geometry;
        for cell in parent.active_cells() {
            let low = cell.saturating_sub(UVec3::splat(ring));
            let high = (cell + ring + 1).min(UVec3::splat(geometry.padded_cells()));
            for child in box_indices(geometry.refined_node(low), geometry.refined_node(high)) {
                self.visit(sampler, child)?;
            }
        }
        Ok(())
    }

    /// Visits, for each crossed edge of the parent's cells, the child that has the crossed half of that edge.
    fn visit_crossed_halves<F: ScalarField + ?Sized>(
        &mut self,
        sampler: &mut Sampler<F>,
        parent: &SparseGrid,
    ) -> Result<()> {
        let geometry = parent.geometry;
        let mut halves = Vec::new();
        for cell in parent.active_cells() {
            let crossed = case(parent.inside_corners(cell)).crossed_edges;
            for edge in (0..12).filter(|edge| crossed >> edge & 1 == 1) {
                let (first, axis) = (cell + corner_offset(edge_start(edge)), UVec3::AXES[edge_axis(edge)]);
                let (start, end) = (geometry.refined_node(first), geometry.refined_node(first + axis));
                for node in [start, start + axis, end] {
                    self.request(sampler, node)?;
                }
                // The child of `cell` that touches the edge's first half.
                let child = geometry.refined_node(cell).max(start.saturating_sub(UVec3::ONE));
                halves.push((child, start, axis));
            }
        }
        self.evaluate_pending(sampler)?;
        for (child, start, axis) in halves {
            let inside = |node| self.grid.known_value(node).is_some_and(|value| value >= 0.0);
            let first_half = inside(start) != inside(start + axis);
            self.visit(sampler, if first_half { child } else { child + axis })?;
        }
        Ok(())
    }

    /// Visits the cells that hold the seeds, and where the surface does not meet such a cell, its 26 neighbours.
    fn visit_seeds<F: ScalarField + ?Sized>(&mut self, sampler: &mut Sampler<F>, seeds: &[Vec3]) -> Result<()> {
        let geometry = self.grid.geometry;
        let cells: Vec<UVec3> = seeds.iter().map(|&seed| geometry.cell_of(seed)).collect();
        for &cell in &cells {
            self.visit(sampler, cell)?;
        }
        self.flood(sampler)?;
        for cell in cells {
            if !self.grid.is_active(cell) {
                for neighbour in box_indices(cell - 1, cell + 2) {
                    self.visit(sampler, neighbour)?;
                }
            }
        }
        self.flood(sampler)
    }
}

/// All indices from `low` up to but without `high`, x fastest.
fn box_indices(low: UVec3, high: UVec3) -> impl Iterator<Item = UVec3> {
    (low.z..high.z)
        .flat_map(move |z| (low.y..high.y).flat_map(move |y| (low.x..high.x).map(move |x| UVec3::new(x, y, z))))
}
