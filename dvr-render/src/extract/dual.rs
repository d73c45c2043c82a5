//! Dual contouring: a vertex for each connected patch of the surface in a cell, a quadrilateral for each crossed edge.
//!
//! One vertex per cell (Ju et al. 2002) pinches the surface where two of its patches pass through one cell. One vertex per
//! loop of the marching cubes case (dual marching cubes, Nielson 2004) does not, and every crossed edge then lies in
//! one loop of each of its four cells. Together with parted faces (see [`super::marching_cubes`]) the mesh is a closed,
//! oriented manifold: two vertices share at most one side of a quadrilateral, and the diagonals of quadrilaterals join
//! cells that have only one edge in common.

use glam::{DVec3, UVec3, Vec3};
use rayon::prelude::*;

use super::grid::{GridGeometry, SparseGrid};
use super::marching_cubes::{case, edge_axis, edge_start};
use super::qef::QuadraticError;
use super::surface::{CrossedEdges, Crossing};

/// Vertices keep this far from the faces of their cell, in cells, so that those of different cells never fall together.
///
/// Letting them go where the planes meet, be it beyond a face, would bring the corners of exact shapes nearer to the
/// truth, but it does nothing for trained fields, whose meshes then intersect themselves at a hundred times as many
/// places.
const MARGIN: f64 = 1e-3;

/// A connected piece of the surface in one cell.
#[derive(Clone, Copy, Debug)]
struct Patch {
    cell: UVec3,
    /// Whether the cell has no other.
    alone: bool,
    /// Its first crossing in [`DualMesh::members`].
    first: usize,
}

/// The mesh before its vertices have their places.
#[derive(Debug)]
pub(super) struct DualMesh {
    /// The crossed edges, with the numbers that the quadrilaterals have.
    pub crossings: Vec<Crossing>,
    patches: Vec<Patch>,
    /// Numbers of the crossings of all patches, one patch after the other.
    members: Vec<u32>,
    /// The patches around each crossed edge, counter-clockwise seen from outside.
    quads: Vec<[u32; 4]>,
}

impl DualMesh {
    /// Connects the cells that the surface passes through.
    ///
    /// Order of patches and crossings depends on the set of cells only, not on how they were found.
    pub fn of(grid: &SparseGrid) -> Self {
        let mut edges = CrossedEdges::of(grid);
        let crossings = edges.number(grid);
        let (mut patches, mut members) = (Vec::new(), Vec::with_capacity(4 * crossings.len()));
        let mut quads = vec![[0; 4]; crossings.len()];
        for cell in grid.active_cells() {
            let slots = grid.corner_slots(cell);
            let loops = loops_of(grid, cell);
            for polygon in loops {
                for &edge in polygon {
                    let crossing = edges.vertex(slots[edge_start(edge) as usize], edge_axis(edge));
                    let place = place_around(edge);
                    // Seen from its upper end, the cells stand counter-clockwise around an edge.
                    let place = if crossings[crossing as usize].rises() { 3 - place } else { place };
                    quads[crossing as usize][place] = patches.len() as u32;
                    members.push(crossing);
                }
                patches.push(Patch { cell, alone: loops.len() == 1, first: members.len() - polygon.len() });
            }
        }
        Self { crossings, patches, members, quads }
    }

    /// Places each vertex in its cell where the planes through its patch's crossings meet, given their unit normals.
    pub fn vertices(&self, geometry: &GridGeometry, normals: &[Vec3]) -> Vec<Vec3> {
        let place = |(vertex, patch): (usize, &Patch)| {
            let cell = patch.cell.as_dvec3();
            let mut error = QuadraticError::new();
            for &member in self.members_of(vertex) {
                error.add(self.crossings[member as usize].grid_position() - cell, normals[member as usize].as_dvec3());
            }
            // Patches that share a cell are finer than the grid can follow; their mass points are sure to lie apart.
            let minimiser = || error.minimiser_within(DVec3::splat(MARGIN), DVec3::splat(1.0 - MARGIN));
            geometry.at(cell + if patch.alone { minimiser() } else { error.mass_point() })
        };
        self.patches.par_iter().enumerate().with_min_len(256).map(place).collect()
    }

    /// The mean direction of the normals at each vertex's crossings; zero where they cancel.
    pub fn vertex_normals(&self, normals: &[Vec3]) -> Vec<Vec3> {
        let sum = |vertex| self.members_of(vertex).iter().map(|&member| normals[member as usize]).sum::<Vec3>();
        (0..self.patches.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|vertex| sum(vertex).normalize_or_zero())
            .collect()
    }

    /// The crossings of a vertex's patch.
    fn members_of(&self, vertex: usize) -> &[u32] {
        let end = self.patches.get(vertex + 1).map_or(self.members.len(), |next| next.first);
        &self.members[self.patches[vertex].first..end]
    }

    /// Two triangles for each quadrilateral, parted by the diagonal along which they fit the vertices' normals better.
    pub fn triangles(&self, vertices: &[Vec3], normals: &[Vec3]) -> Vec<[u32; 3]> {
        self.quads.par_iter().with_min_len(256).flat_map_iter(|&quad| split(quad, vertices, normals)).collect()
    }

    /// Whether a vertex closes the surface at the border of the cube.
    pub fn is_on_border(&self, geometry: &GridGeometry, vertex: u32) -> bool {
        geometry.is_virtual_cell(self.patches[vertex as usize].cell)
    }
}

/// The loops of a cell, with a face parted if that is needed on both its sides.
fn loops_of(grid: &SparseGrid, cell: UVec3) -> &'static [Vec<u8>] {
    let here = case(grid.inside_corners(cell));
    let Some((face, parted)) = &here.parting else { return &here.loops };
    let axis = UVec3::AXES[usize::from(face / 2)];
    let beyond = if face % 2 == 0 { cell - axis } else { cell + axis };
    match &case(grid.inside_corners(beyond)).parting {
        Some((opposite, _)) if *opposite == face ^ 1 => parted,
        _ => &here.loops,
    }
}

/// The place of a cell among the four around one of its edges, counter-clockwise seen from the edge's upper end.
fn place_around(edge: u8) -> usize {
    // The edge lies on the low side of the cell (bit clear) or on the high side along each of the two other axes.
    [0, 1, 3, 2][usize::from(edge % 4)]
}

/// The two triangles of a quadrilateral whose normals agree better with those of their corners; where both diagonals
/// are as good, the shorter one parts them.
fn split([a, b, c, d]: [u32; 4], vertices: &[Vec3], normals: &[Vec3]) -> [[u32; 3]; 2] {
    /// Agreements that differ by less are equal: on smooth parts the shape of the triangles counts.
    const NOTICEABLE: f32 = 0.02;

    let agreement = |triangle: [u32; 3]| {
        let [p, q, r] = triangle.map(|vertex| vertices[vertex as usize]);
        let normal = (q - p).cross(r - p).normalize_or_zero();
        triangle.into_iter().map(|vertex| normal.dot(normals[vertex as usize])).sum::<f32>()
    };
    let length = |i: u32, j: u32| vertices[i as usize].distance_squared(vertices[j as usize]);
    let (by_ac, by_bd) = ([[a, b, c], [a, c, d]], [[a, b, d], [b, c, d]]);
    let gain: f32 = by_ac.map(agreement).iter().sum::<f32>() - by_bd.map(agreement).iter().sum::<f32>();
    let prefer_ac = if gain.abs() > NOTICEABLE { gain > 0.0 } else { length(a, c) <= length(b, d) };
    if prefer_ac { by_ac } else { by_bd }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadrilateral_is_parted_along_its_crease_and_else_by_its_shorter_diagonal() {
        // A kite, and how high its corners lie.
        let corners = |[a, b, c, d]: [f32; 4]| {
            [Vec3::new(0.0, 0.0, a), Vec3::new(1.0, -0.4, b), Vec3::new(2.0, 0.0, c), Vec3::new(1.0, 0.4, d)]
        };
        let is_by_ac = |quad: [u32; 4], heights: [f32; 4], normals: [Vec3; 4]| {
            let triangles = split(quad, &corners(heights), &normals);
            assert!(triangles.concat().iter().all(|corner| quad.contains(corner)));
            triangles == [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
        };
        let up = [Vec3::Z; 4];
        assert!(!is_by_ac([0, 1, 2, 3], [0.0; 4], up) && is_by_ac([1, 2, 3, 0], [0.0; 4], up), "the shorter one");
        // A roof whose ridge runs from corner 0 to corner 2; there both of its sides meet.
        let tilted = |y: f32| Vec3::new(0.0, y, 0.4).normalize();
        let sides = [Vec3::Z, tilted(-0.5), Vec3::Z, tilted(0.5)];
        assert!(is_by_ac([0, 1, 2, 3], [0.5, 0.0, 0.5, 0.0], sides), "the ridge, though it is longer");
    }
}
