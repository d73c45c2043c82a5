//! The nodes of a lattice that carry parameters.

use crate::lattice::Lattice;

/// A set of nodes, as runs along x: what is trained, and all that training has to touch.
#[derive(Clone, Debug, PartialEq)]
pub struct ActiveNodes {
    lattice: Lattice,
    /// First node and length of each run, in rising order.
    runs: Vec<(u32, u32)>,
    /// Index of the first run of each layer of constant z, and the number of runs.
    layers: Vec<usize>,
    count: usize,
}

impl ActiveNodes {
    /// The nodes for which `is_active` holds.
    pub fn new(lattice: &Lattice, is_active: impl Fn(usize) -> bool) -> Self {
        let (nodes, mut runs, mut layers, mut count) = (lattice.nodes(), Vec::<(u32, u32)>::new(), Vec::new(), 0);
        for row in 0..nodes * nodes {
            if row % nodes == 0 {
                layers.push(runs.len());
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
        Self { lattice: *lattice, runs, layers, count }
    }

    /// The nodes of either set.
    ///
    /// # Panics
    /// When their lattices differ.
    pub fn union(a: &Self, b: &Self) -> Self {
        assert_eq!(a.lattice, b.lattice, "sets of nodes of one lattice");
        let mut active = vec![false; a.lattice.len()];
        a.iter().chain(b.iter()).for_each(|node| active[node] = true);
        Self::new(&a.lattice, |node| active[node])
    }

    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// How many nodes there are in the set.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Runs `(first node, length)` of the layer `z`, in rising order.
    pub fn layer(&self, z: usize) -> &[(u32, u32)] {
        &self.runs[self.layers[z]..self.layers[z + 1]]
    }

    /// All nodes of the set, in rising order.
    pub fn iter(&self) -> impl Iterator<Item = usize> + '_ {
        self.runs.iter().flat_map(|&(start, length)| start as usize..(start + length) as usize)
    }

    /// The nodes of the lattice with half the resolution that some of these nodes are interpolated from.
    ///
    /// # Panics
    /// When the number of cells is odd.
    pub fn coarser(&self) -> Self {
        let cells = self.lattice.cells();
        assert_eq!(cells % 2, 0, "{cells} cells cannot be halved");
        let coarse = Lattice::new(cells / 2 + 1, self.lattice.half_extent());
        let mut needed = vec![false; coarse.len()];
        for node in self.iter() {
            let [x, y, z] = self.lattice.coordinates(node).map(|c| [c / 2, c.div_ceil(2)]);
            for (cx, cy, cz) in (0..8).map(|i| (x[i & 1], y[i >> 1 & 1], z[i >> 2])) {
                needed[coarse.index([cx, cy, cz])] = true;
            }
        }
        Self::new(&coarse, |node| needed[node])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_hold_the_nodes_that_were_asked_for() {
        let lattice = Lattice::new(9, 0.5);
        let wanted = |node: usize| node % 7 != 3 && node % 5 < 3;
        let active = ActiveNodes::new(&lattice, wanted);
        assert_eq!(active.iter().collect::<Vec<_>>(), (0..lattice.len()).filter(|&n| wanted(n)).collect::<Vec<_>>());
        assert_eq!(active.count(), active.iter().count());
        let by_layer: usize = (0..9).flat_map(|z| active.layer(z)).map(|run| run.1 as usize).sum();
        assert_eq!(by_layer, active.count());
        assert!((0..9).all(|z| active.layer(z).iter().all(|run| run.0 as usize / 81 == z)));
    }

    #[test]
    fn runs_do_not_cross_rows() {
        let lattice = Lattice::new(3, 0.5);
        let active = ActiveNodes::new(&lattice, |_| true);
        assert_eq!(active.layer(1), [(9, 3), (12, 3), (15, 3)]);
    }

    #[test]
    fn coarser_nodes_carry_all_fine_ones() {
        let lattice = Lattice::new(9, 0.5);
        let only = lattice.index([3, 4, 5]);
        let coarse = ActiveNodes::new(&lattice, |node| node == only).coarser();
        let found: Vec<_> = coarse.iter().map(|node| coarse.lattice().coordinates(node)).collect();
        assert_eq!(found, [[1, 2, 2], [2, 2, 2], [1, 2, 3], [2, 2, 3]]);
    }
}
