//! From the signs on a grid to vertices on its edges and triangles between them.

use glam::{DVec3, UVec3, Vec3};

use super::grid::{Bits, GridGeometry, Slot, SparseGrid};
use super::marching_cubes::{case, edge_axis, edge_start};

/// Crossings keep this far from the ends of their edge, in units of the edge.
///
/// Where the field is exactly at the level on a node, the crossings of all edges of that node would fall together, and
/// a program that merges vertices by position (most do, on loading) would find edges with four faces.
const MARGIN: f64 = 1e-3;

/// Where the surface crosses an edge of the grid: one vertex of marching cubes' mesh, one quadrilateral of the dual.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    /// The edge's lower node.
    pub node: UVec3,
    /// The axis along which the edge runs.
    pub axis: usize,
    /// Values, relative to the level, at the edge's lower and upper node: one is negative, one is not.
    pub values: [f32; 2],
    /// The crossing's place on the edge, 0 at the lower node and 1 at the upper.
    pub t: f64,
}

impl Crossing {
    fn new(node: UVec3, axis: usize, values: [f32; 2]) -> Self {
        let [low, high] = values.map(f64::from);
        Self { node, axis, values, t: keep_off_nodes(low / (low - high)) }
    }

    /// Where it lies.
    pub fn position(&self, geometry: &GridGeometry) -> Vec3 {
        geometry.point(self.node, self.axis, self.t)
    }

    /// The same in units of cells from the lowest corner of the virtual layer.
    pub fn grid_position(&self) -> DVec3 {
        self.node.as_dvec3() + self.t * DVec3::AXES[self.axis]
    }

    /// Whether the edge's upper node is the one inside.
    pub fn rises(&self) -> bool {
        self.values[1] >= 0.0
    }

    /// The direction along the edge that leads out of the object.
    pub fn outward(&self) -> Vec3 {
        if self.rises() { -Vec3::AXES[self.axis] } else { Vec3::AXES[self.axis] }
    }

    /// Whether the surface was cut here by the border of the cube.
    pub fn is_on_border(&self, geometry: &GridGeometry) -> bool {
        geometry.is_virtual(self.node) || geometry.is_virtual(self.node + UVec3::AXES[self.axis])
    }
}

/// A place on an edge, moved to where it cannot fall together with a crossing of another edge.
pub(super) fn keep_off_nodes(t: f64) -> f64 {
    t.clamp(MARGIN, 1.0 - MARGIN)
}

/// The mesh of the cells that the surface passes through: closed, oriented, and a manifold.
///
/// Order of vertices and faces depends on the set of cells only, not on how they were found.
pub(super) fn triangulate(grid: &SparseGrid) -> (Vec<Crossing>, Vec<[u32; 3]>) {
    let mut edges = CrossedEdges::of(grid);
    let crossings = edges.number(grid);
    let mut faces = Vec::with_capacity(2 * crossings.len());
    for cell in grid.active_cells() {
        let slots = grid.corner_slots(cell);
        let case = case(grid.inside_corners(cell));
        let vertex = |edge: u8| edges.vertex(slots[edge_start(edge) as usize], edge_axis(edge));
        faces.extend(case.triangles.iter().map(|triangle| triangle.map(vertex)));
    }
    (crossings, faces)
}

/// The crossed edges of a grid, numbered: per block and axis a set of lower nodes and running counts.
pub(super) struct CrossedEdges {
    blocks: Vec<[(Bits, [u32; 8]); 3]>,
}

impl CrossedEdges {
    /// The crossed edges of the active cells, not yet numbered.
    pub fn of(grid: &SparseGrid) -> Self {
        let mut blocks = vec![[(Bits::default(), [0; 8]); 3]; grid.block_count()];
        for cell in grid.active_cells() {
            let slots = grid.corner_slots(cell);
            let crossed = case(grid.inside_corners(cell)).crossed_edges;
            for edge in (0..12).filter(|edge| crossed >> edge & 1 == 1) {
                let start = slots[edge_start(edge) as usize];
                blocks[start.block()][edge_axis(edge)].0.insert(start.local());
            }
        }
        Self { blocks }
    }

    /// Gives the edges their numbers, and returns the crossings in that order.
    pub fn number(&mut self, grid: &SparseGrid) -> Vec<Crossing> {
        let mut crossings = Vec::new();
        for block in grid.blocks_in_order() {
            for (axis, (starts, counts)) in self.blocks[block].iter_mut().enumerate() {
                let mut count = crossings.len() as u32;
                for (word, first) in starts.0.iter().zip(counts) {
                    *first = count;
                    count += word.count_ones();
                }
                for local in starts.iter() {
                    let node = grid.node_at(block, local);
                    let value = |node| grid.known_value(node).unwrap_or(f32::MIN);
                    crossings.push(Crossing::new(node, axis, [value(node), value(node + UVec3::AXES[axis])]));
                }
            }
        }
        crossings
    }

    /// The number of a crossed edge.
    pub fn vertex(&self, start: Slot, axis: usize) -> u32 {
        let (starts, counts) = &self.blocks[start.block()][axis];
        let (word, bit) = (start.local() / 64, start.local() % 64);
        counts[word] + (starts.0[word] & ((1 << bit) - 1)).count_ones()
    }
}
