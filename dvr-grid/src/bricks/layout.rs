//! Which rows of which bricks are stored, and where.

use std::ops::Range;

use dvr_core::voxel::VoxelGrid;

use crate::active::ActiveNodes;

/// Nodes along the edge of a brick, and of a row.
pub(crate) const EDGE: usize = 8;

/// Rows of a brick.
pub(crate) const ROWS: usize = EDGE * EDGE;

/// Bricks that one task works on. Sums are by task: their number must not depend on that of the threads.
const TASK: usize = 16;

/// Numbers of eight nodes side by side along x, `C` each.
pub(crate) type Row<const C: usize> = [[f32; C]; EDGE];

/// Where a row or a brick lies that is not stored: out of the surface, or within. Nothing but occupancy asks.
const OUTSIDE: u32 = u32::MAX;
const INSIDE: u32 = u32::MAX - 1;

/// Of each set of nodes of a row: 1 for those in it, 0 for the others.
static LANES: [[f32; EDGE]; 1 << EDGE] = lanes();

const fn lanes() -> [[f32; EDGE]; 1 << EDGE] {
    let mut lanes = [[0.0; EDGE]; 1 << EDGE];
    let mut set = 0;
    while set < lanes.len() {
        let mut lane = 0;
        while lane < EDGE {
            lanes[set][lane] = (set >> lane & 1) as f32;
            lane += 1;
        }
        set += 1;
    }
    lanes
}

/// Which rows are stored besides those with active nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stored {
    /// None.
    Active,
    /// Those of all corners of the cells around active nodes.
    Around,
    /// All.
    All,
}

/// A brick of which something is stored.
#[derive(Clone, Debug)]
pub(crate) struct Brick {
    /// Coordinates, counted in bricks.
    pub at: [usize; 3],
    /// Its rows with active nodes.
    first: u32,
    end: u32,
    /// Of each row, by y and then by z.
    slots: [u32; ROWS],
}

/// What is known of a row with active nodes.
#[derive(Clone, Copy, Debug, Default)]
struct ActiveRow {
    /// A bit for each node: whether it is active.
    nodes: u8,
    /// Which row of its brick it is.
    place: u8,
}

/// Which rows of which bricks are stored. Rows with active nodes come first, brick by brick; then those without.
#[derive(Clone, Debug)]
pub(crate) struct BrickLayout {
    grid: VoxelGrid,
    /// Bricks along an edge.
    edge: usize,
    /// Where each brick lies in `bricks`.
    table: Vec<u32>,
    bricks: Vec<Brick>,
    rows: Vec<ActiveRow>,
    /// Of each row with active nodes, the rows before and after it along x, y and z; where none is stored, the number of
    /// stored rows.
    neighbours: Vec<[u32; 6]>,
    stored: usize,
}

impl BrickLayout {
    /// For the active nodes, and what is asked for besides.
    pub fn new(active: &ActiveNodes, stored: Stored) -> Self {
        let grid = *active.grid();
        let (nodes, edge) = (grid.nodes(), grid.nodes().div_ceil(EDGE));
        let index = |x: usize, y: usize, z: usize| ((z / EDGE) * edge + y / EDGE) * edge + x;
        let bit = |y: usize, z: usize| 1u64 << (z % EDGE * EDGE + y % EDGE);
        let mut with_active = vec![0u64; edge.pow(3)];
        let mut all = if stored == Stored::All { whole(nodes, edge) } else { vec![0u64; edge.pow(3)] };
        for ([x, y, z], length) in runs(active) {
            for brick in x / EDGE..=(x + length - 1) / EDGE {
                with_active[index(brick, y, z)] |= bit(y, z);
            }
            if stored != Stored::Around {
                continue;
            }
            let around = |at: usize| at.saturating_sub(1)..=(at + 1).min(nodes - 1);
            let bricks = x.saturating_sub(1) / EDGE..=(x + length).min(nodes - 1) / EDGE;
            for (z, y) in around(z).flat_map(|z| around(y).map(move |y| (z, y))) {
                bricks.clone().for_each(|brick| all[index(brick, y, z)] |= bit(y, z));
            }
        }
        let mut layout = Self {
            grid,
            edge,
            table: vec![OUTSIDE; edge.pow(3)],
            bricks: Vec::new(),
            rows: Vec::new(),
            neighbours: Vec::new(),
            stored: 0,
        };
        layout.number(&with_active, &all);
        for ([x, y, z], length) in runs(active) {
            for at in x..x + length {
                let slot = layout.code(at / EDGE, y, z) as usize;
                layout.rows[slot].nodes |= 1 << (at % EDGE);
            }
        }
        layout.connect();
        layout
    }

    /// Numbers the rows: bits of those with active nodes, and of all that are stored, for each brick.
    fn number(&mut self, with_active: &[u64], all: &[u64]) {
        for (index, (&active, &others)) in with_active.iter().zip(all).enumerate() {
            if active | others == 0 {
                continue;
            }
            self.table[index] = self.bricks.len() as u32;
            let (mut slots, first) = ([OUTSIDE; ROWS], self.rows.len() as u32);
            for place in (0..ROWS).filter(|place| active >> place & 1 == 1) {
                slots[place] = self.rows.len() as u32;
                self.rows.push(ActiveRow { nodes: 0, place: place as u8 });
            }
            let at = [index % self.edge, index / self.edge % self.edge, index / (self.edge * self.edge)];
            self.bricks.push(Brick { at, first, end: self.rows.len() as u32, slots });
        }
        self.stored = self.rows.len();
        for brick in &mut self.bricks {
            let [x, y, z] = brick.at;
            let others = all[(z * self.edge + y) * self.edge + x];
            for (place, slot) in brick.slots.iter_mut().enumerate() {
                if others >> place & 1 == 1 && *slot == OUTSIDE {
                    *slot = self.stored as u32;
                    self.stored += 1;
                }
            }
        }
    }

    /// Finds the neighbours of rows.
    fn connect(&mut self) {
        let mut neighbours = Vec::with_capacity(self.rows.len());
        for brick in &self.bricks {
            for slot in brick.rows() {
                let [x, y, z] = self.place(brick, slot).map(|at| at as isize);
                let slot = |x: isize, y: isize, z: isize| {
                    let (nodes, edge) = (self.grid.nodes() as isize, self.edge as isize);
                    let is_there = (0..edge).contains(&x) && (0..nodes).contains(&y) && (0..nodes).contains(&z);
                    let code = if is_there { self.code(x as usize, y as usize, z as usize) } else { OUTSIDE };
                    code.min(self.stored as u32)
                };
                neighbours.push([
                    slot(x - 1, y, z),
                    slot(x + 1, y, z),
                    slot(x, y - 1, z),
                    slot(x, y + 1, z),
                    slot(x, y, z - 1),
                    slot(x, y, z + 1),
                ]);
            }
        }
        self.neighbours = neighbours;
    }

    /// Says of bricks and rows that are not stored on which side of the surface they are; `is_inside` is asked of one node
    /// of each, by its coordinates.
    pub fn set_sides(&mut self, is_inside: impl Fn([usize; 3]) -> bool) {
        let side = |at: [usize; 3]| if is_inside(at) { INSIDE } else { OUTSIDE };
        let (nodes, edge) = (self.grid.nodes(), self.edge);
        for (index, code) in self.table.iter_mut().enumerate().filter(|(_, code)| **code >= INSIDE) {
            *code = side([index % edge, index / edge % edge, index / (edge * edge)].map(|at| at * EDGE));
        }
        for brick in &mut self.bricks {
            let [x, y, z] = brick.at.map(|at| at * EDGE);
            for (place, code) in brick.slots.iter_mut().enumerate().filter(|(_, code)| **code >= INSIDE) {
                let at = [x, y + place % EDGE, z + place / EDGE];
                *code = if at[1] < nodes && at[2] < nodes { side(at) } else { OUTSIDE };
            }
        }
    }

    /// The grid.
    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    /// Bricks of which something is stored.
    pub fn bricks(&self) -> &[Brick] {
        &self.bricks
    }

    /// Rows with active nodes; these come first.
    pub fn active_rows(&self) -> usize {
        self.rows.len()
    }

    /// Rows that are stored.
    pub fn stored_rows(&self) -> usize {
        self.stored
    }

    /// Of a row with active nodes, a bit for each node: whether it is active.
    #[inline]
    pub fn active_nodes(&self, slot: usize) -> u8 {
        self.rows[slot].nodes
    }

    /// The same as a factor for each node.
    #[inline(always)]
    pub fn active_lanes(&self, slot: usize) -> &'static [f32; EDGE] {
        &LANES[usize::from(self.rows[slot].nodes)]
    }

    /// The rows before and after a row with active nodes along x, y and z; the number of stored rows where none is
    /// stored.
    #[inline]
    pub fn neighbours(&self, slot: usize) -> &[u32; 6] {
        &self.neighbours[slot]
    }

    /// Which brick along x, and which y and z, a row of a brick has.
    #[inline]
    pub fn place(&self, brick: &Brick, slot: usize) -> [usize; 3] {
        let place = usize::from(self.rows[slot].place);
        [brick.at[0], brick.at[1] * EDGE + place % EDGE, brick.at[2] * EDGE + place / EDGE]
    }

    /// The stored rows of the nodes at, after along y, after along z, and after along both, where all are of one brick.
    #[inline]
    pub fn rows_around(&self, [x, y, z]: [usize; 3]) -> Option<[usize; 4]> {
        let (row, plane) = (y % EDGE, z % EDGE);
        if row + 1 == EDGE || plane + 1 == EDGE {
            return None;
        }
        let slots = &self.bricks[self.brick([x / EDGE, y / EDGE, z / EDGE]).ok()?].slots;
        let first = plane * EDGE + row;
        let found = [slots[first], slots[first + 1], slots[first + EDGE], slots[first + EDGE + 1]];
        found.iter().all(|&code| code < INSIDE).then(|| found.map(|code| code as usize))
    }

    /// The stored row of a node, and which of its row the node is.
    #[inline]
    pub fn slot(&self, [x, y, z]: [usize; 3]) -> Option<(usize, usize)> {
        let code = self.code(x / EDGE, y, z);
        (code < INSIDE).then_some((code as usize, x % EDGE))
    }

    /// Whether a node of which nothing is stored lies inside; see [`BrickLayout::set_sides`].
    pub fn is_inside(&self, [x, y, z]: [usize; 3]) -> bool {
        self.code(x / EDGE, y, z) == INSIDE
    }

    /// Where an active node is kept: its row, and which of the row it is.
    #[inline]
    pub fn active_slot(&self, at: [usize; 3]) -> Option<(usize, usize)> {
        let (slot, lane) = self.slot(at)?;
        (slot < self.rows.len() && self.rows[slot].nodes >> lane & 1 == 1).then_some((slot, lane))
    }

    /// Where a brick lies among those of which something is stored, by its coordinates in bricks.
    ///
    /// # Errors
    /// Whether it is inside, where nothing of it is stored.
    #[inline]
    pub fn brick(&self, [x, y, z]: [usize; 3]) -> Result<usize, bool> {
        let code = self.table[(z * self.edge + y) * self.edge + x];
        if code < INSIDE { Ok(code as usize) } else { Err(code == INSIDE) }
    }

    /// Codes of the rows, by y and then by z, of a brick and those after it, as many as asked for along each axis, by z, y and x:
    /// where a row lies, or no row at all; without rows where nothing is stored, or beyond the grid. `first` are coordinates in
    /// bricks, which may be -1.
    #[inline]
    pub fn slots_around<const N: usize>(&self, first: [isize; 3]) -> [[[&[u32; ROWS]; N]; N]; N] {
        let along =
            |axis: usize, by: usize| usize::try_from(first[axis] + by as isize).ok().filter(|&at| at < self.edge);
        let slots = |x: usize, y: usize, z: usize| {
            let brick = self.brick([along(0, x)?, along(1, y)?, along(2, z)?]).ok()?;
            Some(&self.bricks[brick].slots)
        };
        std::array::from_fn(|z| {
            std::array::from_fn(|y| std::array::from_fn(|x| slots(x, y, z).unwrap_or(&[OUTSIDE; ROWS])))
        })
    }

    /// Bricks along an edge.
    pub fn edge(&self) -> usize {
        self.edge
    }

    #[inline]
    fn code(&self, brick: usize, y: usize, z: usize) -> u32 {
        let index = self.table[((z / EDGE) * self.edge + y / EDGE) * self.edge + brick];
        if index >= INSIDE { index } else { self.bricks[index as usize].slots[z % EDGE * EDGE + y % EDGE] }
    }

    /// Bricks in groups, each the work of one task.
    pub fn tasks(&self) -> impl ExactSizeIterator<Item = &[Brick]> {
        self.bricks.chunks(TASK)
    }

    /// Cuts what is stored for rows with active nodes into what each task of [`BrickLayout::tasks`] works on; what is
    /// stored for other rows is left out.
    pub fn split<'a, T>(&self, stored: &'a mut [T]) -> Vec<&'a mut [T]> {
        let mut rest = stored;
        self.tasks()
            .map(|bricks| {
                let count = bricks[bricks.len() - 1].end - bricks[0].first;
                rest.split_off_mut(..count as usize).unwrap_or_default()
            })
            .collect()
    }

    /// What is given for active nodes, `C` numbers each in their order, in rows; zero at other nodes of rows with
    /// active ones.
    pub fn rows_of<const C: usize>(&self, active: &ActiveNodes, given: &[f32]) -> Vec<Row<C>> {
        let mut rows = vec![[[0.0; C]; EDGE]; self.rows.len()];
        for ((slot, lane), given) in self.slots(active).zip(given.as_chunks::<C>().0) {
            rows[slot][lane] = *given;
        }
        rows
    }

    /// The reverse of [`BrickLayout::rows_of`].
    pub fn of_rows<const C: usize>(&self, active: &ActiveNodes, rows: &[Row<C>]) -> Vec<f32> {
        let mut taken = Vec::with_capacity(C * active.count());
        for ([mut x, y, z], length) in runs(active) {
            let end = x + length;
            while x < end {
                // What lies in one row at once.
                let (lane, count) = (x % EDGE, (EDGE - x % EDGE).min(end - x));
                let row = &rows[self.code(x / EDGE, y, z) as usize];
                taken.extend_from_slice(row[lane..lane + count].as_flattened());
                x += count;
            }
        }
        taken
    }

    /// Rows of the active nodes, and which of its row each is, row by row.
    pub fn active_places(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let lanes = move |slot| (0..EDGE).filter(move |&lane| self.active_nodes(slot) >> lane & 1 == 1);
        (0..self.rows.len()).flat_map(move |slot| lanes(slot).map(move |lane| (slot, lane)))
    }

    /// The active nodes, row by row as [`BrickLayout::active_places`].
    #[cfg(feature = "gpu")]
    pub fn active_indices(&self) -> impl Iterator<Item = usize> + '_ {
        let rows =
            self.bricks.iter().flat_map(move |brick| brick.rows().map(move |slot| (slot, self.place(brick, slot))));
        rows.flat_map(move |(slot, [brick, y, z])| {
            let lanes = (0..EDGE).filter(move |&lane| self.active_nodes(slot) >> lane & 1 == 1);
            lanes.map(move |lane| self.grid.index([brick * EDGE + lane, y, z]))
        })
    }

    /// Rows of the active nodes, and which of its row each is, in their order.
    pub fn slots<'a>(&'a self, active: &'a ActiveNodes) -> impl Iterator<Item = (usize, usize)> + 'a {
        runs(active).flat_map(move |([x, y, z], length)| {
            (x..x + length).map(move |x| (self.code(x / EDGE, y, z) as usize, x % EDGE))
        })
    }
}

impl Brick {
    /// Its rows with active nodes.
    #[inline]
    pub fn rows(&self) -> Range<usize> {
        self.first as usize..self.end as usize
    }

    /// Its stored row at `y` and `z`, counted from its lowest corner.
    #[inline]
    pub fn row(&self, y: usize, z: usize) -> Option<usize> {
        let code = self.slots[z * EDGE + y];
        (code < INSIDE).then_some(code as usize)
    }

    /// Whether a row lies inside of which nothing is stored.
    pub fn is_inside(&self, y: usize, z: usize) -> bool {
        self.slots[z * EDGE + y] == INSIDE
    }
}

/// First node and length of each run.
fn runs(active: &ActiveNodes) -> impl Iterator<Item = ([usize; 3], usize)> + '_ {
    let grid = active.grid();
    (0..grid.nodes())
        .flat_map(|z| active.layer(z))
        .map(|&(start, length)| (grid.coordinates(start as usize), length as usize))
}

/// Bits of the rows that each brick of a grid has.
fn whole(nodes: usize, edge: usize) -> Vec<u64> {
    let rows = |at: usize| (nodes - at * EDGE).min(EDGE);
    let of = |index: usize| {
        let (y, z) = (rows(index / edge % edge), rows(index / (edge * edge)));
        (0..z).fold(0u64, |bits, z| bits | (u64::MAX >> (64 - y)) << (z * EDGE))
    };
    (0..edge.pow(3)).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_bricks_around_are_those_of_their_nodes_and_none_lies_beyond_the_grid() {
        let grid = VoxelGrid::new(41, 0.5);
        let active = ActiveNodes::new(&grid, |node| node.wrapping_mul(2_654_435_761) % 97 < 3);
        for stored in [Stored::Active, Stored::Around, Stored::All] {
            let layout = BrickLayout::new(&active, stored);
            let mut found = 0;
            for first in [[-1, -1, -1], [1, 0, -1], [3, 4, 5]] {
                let around = layout.slots_around::<3>(first);
                for (i, place) in (0..27).flat_map(|i| (0..ROWS).map(move |place| (i, place))) {
                    let brick: [isize; 3] = std::array::from_fn(|axis| first[axis] + i / 3isize.pow(axis as u32) % 3);
                    let [dx, dy, dz] = [i % 3, i / 3 % 3, i / 9].map(|at| at as usize);
                    let code = around[dz][dy][dx][place] as usize;
                    let node =
                        [brick[0] * 8, brick[1] * 8 + (place % EDGE) as isize, brick[2] * 8 + (place / EDGE) as isize];
                    let is_in_grid = node.iter().all(|at| (0..grid.nodes() as isize).contains(at));
                    let expected = is_in_grid.then(|| layout.slot(node.map(|at| at as usize))).flatten();
                    assert_eq!((code < layout.stored_rows()).then_some(code), expected.map(|(slot, _)| slot));
                    found += usize::from(expected.is_some());
                }
            }
            assert!(found > 100, "{found}");
        }
    }
}
