//! The nodes of a grid that carry parameters.

use dvr_core::voxel::VoxelGrid;

/// A set of nodes, as runs along x: what is trained, and all that training has to touch.
#[derive(Clone, Debug, PartialEq)]
pub struct ActiveNodes {
    grid: VoxelGrid,
    /// First node and length of each run, in rising order.
    runs: Vec<(u32, u32)>,
    /// Index of the first run of each layer of constant z, and the number of runs.
    layers: Vec<usize>,
    /// Nodes of the set before each layer, and all of them.
    before: Vec<usize>,
}

impl ActiveNodes {
    /// The nodes for which `is_active` holds.
    pub fn new(grid: &VoxelGrid, is_active: impl Fn(usize) -> bool) -> Self {
        let (nodes, mut runs, mut count) = (grid.nodes(), Vec::<(u32, u32)>::new(), 0);
        let (mut layers, mut before) = (Vec::new(), Vec::new());
        for row in 0..nodes * nodes {
            if row % nodes == 0 {
                layers.push(runs.len());
                before.push(count);
            }
            let mut open = false;
            for node in row * nodes..(row + 1) * nodes {
                let active = is_active(node);
                match runs.last_mut() {
                    Some(run) if open && active => run.1 += 1,
                    _ if active => runs.push((node as u32, 1)),
                    _ => {}
                }
                open = active;
                count += usize::from(active);
            }
        }
        layers.push(runs.len());
        before.push(count);
        Self { grid: *grid, runs, layers, before }
    }

    /// None of the nodes.
    pub(crate) fn none(grid: &VoxelGrid) -> Self {
        let layers = vec![0; grid.nodes() + 1];
        Self { grid: *grid, runs: Vec::new(), before: layers.clone(), layers }
    }

    /// The nodes of either set.
    ///
    /// # Panics
    /// When their grids differ.
    pub fn union(a: &Self, b: &Self) -> Self {
        assert_eq!(a.grid, b.grid, "sets of nodes of one grid");
        let mut active = vec![false; a.grid.len()];
        a.iter().chain(b.iter()).for_each(|node| active[node] = true);
        Self::new(&a.grid, |node| active[node])
    }

    /// The nodes of runs along x, first node and length of each, in rising order; no run crosses a row.
    pub(crate) fn of_runs(grid: &VoxelGrid, runs: impl Iterator<Item = (u32, u32)>) -> Self {
        let runs: Vec<(u32, u32)> = runs.collect();
        let plane = grid.nodes().pow(2);
        let (mut layers, mut before, mut count, mut next) = (Vec::new(), Vec::new(), 0, 0);
        for z in 0..=grid.nodes() {
            while runs.get(next).is_some_and(|&(start, _)| (start as usize) < z * plane) {
                count += runs[next].1 as usize;
                next += 1;
            }
            layers.push(next);
            before.push(count);
        }
        Self { grid: *grid, runs, layers, before }
    }

    /// The grid.
    pub fn grid(&self) -> &VoxelGrid {
        &self.grid
    }

    /// How many nodes there are in the set.
    pub fn count(&self) -> usize {
        self.before[self.grid.nodes()]
    }

    /// What is stored for the nodes of a set, for the nodes of another: zero where the first has none.
    pub fn carried(&self, channels: usize, stored: &[f32], to: &Self) -> Vec<f32> {
        let mut own = self.iter().zip(stored.chunks(channels)).peekable();
        let mut carried = Vec::with_capacity(channels * to.count());
        for node in to.iter() {
            while own.next_if(|(other, _)| *other < node).is_some() {}
            match own.next_if(|(other, _)| *other == node) {
                Some((_, values)) => carried.extend_from_slice(values),
                None => carried.extend(std::iter::repeat_n(0.0, channels)),
            }
        }
        carried
    }

    /// Runs `(first node, length)` of the layer `z`, in rising order.
    pub fn layer(&self, z: usize) -> &[(u32, u32)] {
        &self.runs[self.layers[z]..self.layers[z + 1]]
    }

    /// All nodes of the set, in rising order.
    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|&(start, length)| start as usize..(start + length) as usize)
    }

    /// The nodes of the grid with half the resolution that some of these nodes are interpolated from.
    ///
    /// # Panics
    /// When the number of cells is odd.
    pub fn coarser(&self) -> Self {
        let cells = self.grid.cells();
        assert_eq!(cells % 2, 0, "{cells} cells cannot be halved");
        let coarse = VoxelGrid::new(cells / 2 + 1, self.grid.half_extent());
        let mut needed = vec![false; coarse.len()];
        for node in self.iter() {
            let [x, y, z] = self.grid.coordinates(node).map(|c| [c / 2, c.div_ceil(2)]);
            for (cx, cy, cz) in (0..8).map(|i| (x[i & 1], y[i >> 1 & 1], z[i >> 2])) {
                needed[coarse.index([cx, cy, cz])] = true;
            }
        }
        Self::new(&coarse, |node| needed[node])
    }
}

#[cfg(test)]
impl ActiveNodes {
    /// The slow reference of `bricks::near_refined_surface`: all values are given, and every node asks all others within
    /// reach.
    pub(crate) fn near_surface(grid: &VoxelGrid, values: &[f32], reach: usize) -> Self {
        let nodes = grid.nodes();
        let strides = [1, nodes, nodes * nodes];
        let changes = |node: usize| {
            let is_other = |stride: usize| (values[node + stride] >= 0.0) != (values[node] >= 0.0);
            grid.coordinates(node).into_iter().zip(strides).any(|(at, stride)| at + 1 < nodes && is_other(stride))
        };
        let mut near: Vec<bool> = (0..grid.len()).map(changes).collect();
        for stride in strides {
            let before = near.clone();
            for (node, near) in near.iter_mut().enumerate() {
                let at = node / stride % nodes;
                let mut within = at.saturating_sub(reach + 1)..=(at + reach).min(nodes - 1);
                *near = within.any(|other| before[node + other * stride - at * stride]);
            }
        }
        Self::new(grid, |node| near[node] && grid.coordinates(node).iter().all(|&c| c > 0 && c + 1 < nodes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_hold_the_nodes_that_were_asked_for() {
        let grid = VoxelGrid::new(9, 0.5);
        let wanted = |node: usize| node % 7 != 3 && node % 5 < 3;
        let active = ActiveNodes::new(&grid, wanted);
        assert_eq!(active.iter().collect::<Vec<_>>(), (0..grid.len()).filter(|&n| wanted(n)).collect::<Vec<_>>());
        assert_eq!(active.count(), active.iter().count());
        let by_layer: usize = (0..9).flat_map(|z| active.layer(z)).map(|run| run.1 as usize).sum();
        assert_eq!(by_layer, active.count());
        assert!((0..9).all(|z| active.layer(z).iter().all(|run| run.0 as usize / 81 == z)));
    }

    #[test]
    fn numbers_are_carried_from_set_to_set() {
        let grid = VoxelGrid::new(5, 0.5);
        let (some, others) = (
            ActiveNodes::new(&grid, |node| node % 3 == 0 && node < 100),
            ActiveNodes::new(&grid, |node| node % 2 == 0),
        );
        let stored: Vec<f32> = some.iter().flat_map(|node| [node as f32, -(node as f32)]).collect();
        let expected: Vec<f32> = others
            .iter()
            .map(|node| if node % 3 == 0 && node < 100 { node as f32 } else { 0.0 })
            .flat_map(|value| [value, -value])
            .collect();
        assert_eq!(some.carried(2, &stored, &others), expected);
    }

    #[test]
    fn runs_do_not_cross_rows() {
        let grid = VoxelGrid::new(3, 0.5);
        let active = ActiveNodes::new(&grid, |_| true);
        assert_eq!(active.layer(1), [(9, 3), (12, 3), (15, 3)]);
    }

    #[test]
    fn coarser_nodes_carry_all_fine_ones() {
        let grid = VoxelGrid::new(9, 0.5);
        let only = grid.index([3, 4, 5]);
        let coarse = ActiveNodes::new(&grid, |node| node == only).coarser();
        let found: Vec<_> = coarse.iter().map(|node| coarse.grid().coordinates(node)).collect();
        assert_eq!(found, [[1, 2, 2], [2, 2, 2], [1, 2, 3], [2, 2, 3]]);
    }
}
