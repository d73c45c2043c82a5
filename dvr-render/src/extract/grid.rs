//! Node values of a regular grid, stored only in blocks of 8^3 nodes that the surface passes through.

use glam::{DVec3, UVec3, Vec3};

use super::marching_cubes::corner_offset;

/// Nodes along a block's edge, as a power of two.
const SHIFT: u32 = 3;
const MASK: u32 = (1 << SHIFT) - 1;
/// Nodes in a block.
const VOLUME: usize = 1 << (3 * SHIFT);
const NO_BLOCK: u32 = u32::MAX;

/// Where the nodes of a grid lie.
///
/// The cube is divided into `cells` cells per edge. Around it lies one layer of cells whose outer nodes are *virtual*:
/// they count as outside, whatever the field says there, so that a surface cut by the cube's border is closed. Node
/// and cell indices include that layer: real nodes are `1..=cells + 1`, virtual ones `0` and `cells + 2`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GridGeometry {
    /// Real cells along an edge of the cube.
    pub cells: u32,
    /// Half the cube's edge length.
    pub half_extent: f64,
}

impl GridGeometry {
    /// Cells along an edge, the virtual layers included. Valid cell indices are below it, node indices up to it.
    pub fn padded_cells(&self) -> u32 {
        self.cells + 2
    }

    /// Edge length of a cell.
    pub fn cell_size(&self) -> f64 {
        2.0 * self.half_extent / f64::from(self.cells)
    }

    /// Whether a node belongs to the virtual layer.
    pub fn is_virtual(&self, node: UVec3) -> bool {
        node.min_element() == 0 || node.max_element() == self.cells + 2
    }

    /// Whether a cell belongs to the virtual layer, outside the cube.
    pub fn is_virtual_cell(&self, cell: UVec3) -> bool {
        cell.min_element() == 0 || cell.max_element() == self.cells + 1
    }

    /// A point given in units of cells from the lowest corner of the virtual layer.
    pub fn at(&self, grid: DVec3) -> Vec3 {
        ((2.0 * (grid - 1.0) / f64::from(self.cells) - 1.0) * self.half_extent).as_vec3()
    }

    /// The point at `steps` nodes from node `node` along `axis`.
    pub fn point(&self, node: UVec3, axis: usize, steps: f64) -> Vec3 {
        let mut grid = node.as_dvec3();
        grid[axis] += steps;
        self.at(grid)
    }

    /// The cell that holds a point of the cube.
    pub fn cell_of(&self, point: Vec3) -> UVec3 {
        let grid = (point.as_dvec3() / self.half_extent + 1.0) * (0.5 * f64::from(self.cells));
        grid.floor().as_uvec3().min(UVec3::splat(self.cells - 1)) + 1
    }

    /// The grid of half the cell size.
    pub fn refined(&self) -> Self {
        Self { cells: 2 * self.cells, ..*self }
    }

    /// Where a node of this grid is found in the refined grid.
    ///
    /// The virtual layer stays one cell thick, so along each axis cell `c` has the children from the refined node `c`
    /// up to (but without) the refined node `c + 1`: two if it is real, one if it is virtual.
    pub fn refined_node(&self, node: UVec3) -> UVec3 {
        let refined = |index: u32| (2 * index).saturating_sub(1).min(2 * self.cells + 2);
        UVec3::new(refined(node.x), refined(node.y), refined(node.z))
    }
}

/// A set of nodes or cells of one block.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bits(pub [u64; VOLUME / 64]);

impl Bits {
    /// Whether a member is in the set.
    pub fn contains(&self, local: usize) -> bool {
        self.0[local / 64] >> (local % 64) & 1 == 1
    }

    /// Adds a member; whether it was new.
    pub fn insert(&mut self, local: usize) -> bool {
        let new = !self.contains(local);
        self.0[local / 64] |= 1 << (local % 64);
        new
    }

    /// The members in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.0.iter().enumerate().flat_map(|(word, &bits)| {
            std::iter::successors(Some(bits), |&rest| Some(rest & rest.wrapping_sub(1)))
                .take_while(|&rest| rest != 0)
                .map(move |rest| 64 * word + rest.trailing_zeros() as usize)
        })
    }
}

/// What is known about 8^3 nodes, and about the cells whose lowest node is one of them.
#[derive(Clone, Debug)]
struct Block {
    /// Index of the block's lowest node.
    origin: UVec3,
    values: [f32; VOLUME],
    /// Nodes whose value is there or on its way.
    requested: Bits,
    /// Cells all of whose nodes are requested.
    visited: Bits,
    /// Cells that the surface passes through.
    active: Bits,
}

/// A node (or the cell above it) of a [`SparseGrid`]: block and place in the block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot(usize);

impl Slot {
    /// Number of the block.
    pub fn block(self) -> usize {
        self.0 >> (3 * SHIFT)
    }

    /// Number of the node in its block.
    pub fn local(self) -> usize {
        self.0 % VOLUME
    }

    fn new(block: u32, node: UVec3) -> Self {
        let local = (node & MASK).dot(UVec3::new(1, 1 << SHIFT, 1 << (2 * SHIFT)));
        Self((block as usize) << (3 * SHIFT) | local as usize)
    }
}

/// Field values, relative to the level, at those nodes of a geometry that were asked for.
#[derive(Clone, Debug)]
pub(super) struct SparseGrid {
    /// Where the nodes lie.
    pub geometry: GridGeometry,
    /// Number of the block at each place of the coarse grid of blocks.
    table: Vec<u32>,
    blocks_per_edge: u32,
    blocks: Vec<Block>,
}

impl SparseGrid {
    /// A grid of which nothing is known.
    pub fn new(geometry: GridGeometry) -> Self {
        let blocks_per_edge = (geometry.padded_cells() >> SHIFT) + 1;
        Self { geometry, table: vec![NO_BLOCK; blocks_per_edge.pow(3) as usize], blocks_per_edge, blocks: Vec::new() }
    }

    /// How many blocks there are.
    pub fn block_count(&self) -> usize {
        self.blocks.len()
    }

    /// The blocks' numbers in the order of their place, which does not depend on the order of discovery.
    pub fn blocks_in_order(&self) -> impl Iterator<Item = usize> + '_ {
        self.table.iter().filter(|&&block| block != NO_BLOCK).map(|&block| block as usize)
    }

    /// The node of a slot.
    pub fn node(&self, slot: Slot) -> UVec3 {
        self.node_at(slot.block(), slot.local())
    }

    /// The node at a place of a block.
    pub fn node_at(&self, block: usize, local: usize) -> UVec3 {
        let local = local as u32;
        self.blocks[block].origin + UVec3::new(local & MASK, local >> SHIFT & MASK, local >> (2 * SHIFT))
    }

    /// The slot of a node, if its block exists.
    pub fn find(&self, node: UVec3) -> Option<Slot> {
        let block = self.table[self.place(node)];
        (block != NO_BLOCK).then(|| Slot::new(block, node))
    }

    /// The slot of a node, in a new block if need be.
    pub fn slot(&mut self, node: UVec3) -> Slot {
        let place = self.place(node);
        if self.table[place] == NO_BLOCK {
            self.table[place] = self.blocks.len() as u32;
            self.blocks.push(Block {
                origin: node & !MASK,
                values: [0.0; VOLUME],
                requested: Bits::default(),
                visited: Bits::default(),
                active: Bits::default(),
            });
        }
        Slot::new(self.table[place], node)
    }

    fn place(&self, node: UVec3) -> usize {
        let block = (node >> SHIFT).as_usizevec3();
        let n = self.blocks_per_edge as usize;
        block.x + n * (block.y + n * block.z)
    }

    /// The slots of a cell's corners, all of which must have been requested, in the order of the marching cubes table.
    pub fn corner_slots(&self, cell: UVec3) -> [Slot; 8] {
        let slot = |node: UVec3| Slot::new(self.table[self.place(node)], node);
        if (cell & MASK).max_element() < MASK {
            let low = slot(cell);
            return std::array::from_fn(|c| Slot(low.0 + Slot::new(0, corner_offset(c as u8)).0));
        }
        std::array::from_fn(|c| slot(cell + corner_offset(c as u8)))
    }

    /// The value at a node that was requested.
    pub fn value(&self, slot: Slot) -> f32 {
        self.blocks[slot.block()].values[slot.local()]
    }

    /// The value at a node, if it was requested.
    pub fn known_value(&self, node: UVec3) -> Option<f32> {
        let slot = self.find(node)?;
        self.blocks[slot.block()].requested.contains(slot.local()).then(|| self.value(slot))
    }

    /// Stores a value.
    pub fn set_value(&mut self, slot: Slot, value: f32) {
        self.blocks[slot.block()].values[slot.local()] = value;
    }

    /// Marks a node as requested; whether it was not before.
    pub fn mark_requested(&mut self, slot: Slot) -> bool {
        self.blocks[slot.block()].requested.insert(slot.local())
    }

    /// Marks a cell as visited; whether it was not before.
    pub fn mark_visited(&mut self, cell: UVec3) -> bool {
        let slot = self.slot(cell);
        self.blocks[slot.block()].visited.insert(slot.local())
    }

    /// Marks a cell as one that the surface passes through.
    pub fn mark_active(&mut self, cell: UVec3) {
        let slot = self.slot(cell);
        self.blocks[slot.block()].active.insert(slot.local());
    }

    /// Whether the surface passes through a cell.
    pub fn is_active(&self, cell: UVec3) -> bool {
        self.find(cell).is_some_and(|slot| self.blocks[slot.block()].active.contains(slot.local()))
    }

    /// Whether the surface passes through any cell.
    pub fn has_active_cells(&self) -> bool {
        self.blocks.iter().any(|block| block.active.iter().next().is_some())
    }

    /// The cells that the surface passes through, block by block in the order of the blocks' places.
    pub fn active_cells(&self) -> impl Iterator<Item = UVec3> + '_ {
        self.blocks_in_order()
            .flat_map(move |block| self.blocks[block].active.iter().map(move |local| self.node_at(block, local)))
    }

    /// Bit `c` is set where corner `c` of a cell is inside; all corners must have been requested.
    pub fn inside_corners(&self, cell: UVec3) -> u8 {
        let slots = self.corner_slots(cell);
        (0..8).fold(0, |mask, c| mask | u8::from(self.value(slots[c]) >= 0.0) << c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_nodes_and_points_of_a_grid_and_of_its_refinement_fit_together() {
        let grid = GridGeometry { cells: 6, half_extent: 0.55 };
        assert!((grid.cell_size() - 1.1 / 6.0).abs() < 1e-12);
        let of_cube =
            |last: u32| (0..=last).flat_map(move |x| (0..=last).flat_map(move |y| (0..=last).map(move |z| [x, y, z])));
        for cell in of_cube(7) {
            let is_virtual = cell.iter().any(|&index| index == 0 || index == 7);
            let cell = UVec3::from(cell);
            assert_eq!(grid.is_virtual_cell(cell), is_virtual, "{cell}");
            if !is_virtual {
                for inside in [0.01, 0.5, 0.99] {
                    assert_eq!(grid.cell_of(grid.at(cell.as_dvec3() + inside)), cell);
                }
            }
        }
        assert_eq!(grid.cell_of(Vec3::splat(0.55)), UVec3::splat(6), "the far corner is of the last cell");
        for node in of_cube(8).map(UVec3::from) {
            let refined = grid.refined_node(node);
            assert_eq!(grid.is_virtual(node), grid.refined().is_virtual(refined), "{node}");
            if !grid.is_virtual(node) {
                assert!(grid.at(node.as_dvec3()).distance(grid.refined().at(refined.as_dvec3())) < 1e-6, "{node}");
            }
        }
    }
}
