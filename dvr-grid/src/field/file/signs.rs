//! On which side of the surface each node lies: bricks that lie on one side as a whole first, then the nodes of the
//! others, each with the probability that nodes with such neighbours have (as JBIG codes bilevel images, ITU-T T.82, in
//! three dimensions).

use dvr_core::voxel::VoxelGrid;

use super::coder::{BitModel, Coder};
use crate::bricks::{BEFORE, EDGE, NodeSet};

/// Neighbours that come before a node: of each row, by y and z from the node's, those at these places along x.
const NEIGHBOURS: [([isize; 2], &[isize]); 7] = [
    ([0, 0], &[-1, -2]),
    ([-1, 0], &[0, -1, 1]),
    ([-2, 0], &[0]),
    ([0, -1], &[0, -1, 1]),
    ([-1, -1], &[0, -1]),
    ([1, -1], &[0, 1]),
    ([0, -2], &[0]),
];

/// Of all rows.
const NEIGHBOUR_COUNT: usize = 14;

/// What a brick is, among those before it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Outside,
    Inside,
    Both,
}

/// Codes which nodes are inside. A reader ignores `given`; `None` where it comes to the end of its stream before.
pub(super) fn code_signs(coder: &mut impl Coder, grid: &VoxelGrid, given: &NodeSet) -> Option<NodeSet> {
    let (nodes, edge) = (grid.nodes(), grid.nodes().div_ceil(EDGE));
    let mut inside = NodeSet::new(grid);
    let mut sides = vec![Side::Outside; edge.pow(3)];
    let (mut is_mixed, mut is_inside) = ([BitModel::default(); 27], [BitModel::default(); 27]);
    for index in 0..sides.len() {
        let at = [index % edge, index / edge % edge, index / (edge * edge)];
        let before = |axis: usize, stride: usize| if at[axis] > 0 { sides[index - stride] } else { Side::Outside };
        let context = [before(0, 1), before(1, edge), before(2, edge * edge)]
            .into_iter()
            .fold(0, |context, side| 3 * context + side as usize);
        let side = given.side_of_brick(at);
        sides[index] = if coder.bit(&mut is_mixed[context], side.is_none()) {
            Side::Both
        } else if coder.bit(&mut is_inside[context], side == Some(true)) {
            inside.fill_brick(at);
            Side::Inside
        } else {
            Side::Outside
        };
    }
    let mut models = vec![BitModel::default(); 1 << NEIGHBOUR_COUNT];
    for (z, y) in (0..nodes).flat_map(|z| (0..nodes).map(move |y| (z, y))) {
        if coder.is_broken() {
            return None;
        }
        let row = (z / EDGE * edge + y / EDGE) * edge;
        for brick in (0..edge).filter(|brick| sides[row + brick] == Side::Both) {
            let x = EDGE * brick;
            let around = NEIGHBOURS.map(|([dy, dz], _)| inside.window(x, y as isize + dy, z as isize + dz));
            let mut own = around[0];
            for lane in 0..EDGE.min(nodes - x) {
                let place = (BEFORE + lane) as isize;
                let mut context = 0;
                for ((_, places), window) in NEIGHBOURS.iter().zip([own].into_iter().chain(around[1..].iter().copied()))
                {
                    for along in *places {
                        context = context << 1 | (window >> (place + along)) as usize & 1;
                    }
                }
                let at = [x + lane, y, z];
                if coder.bit(&mut models[context], given.contains(at)) {
                    inside.set(at);
                    own |= 1 << place;
                }
            }
        }
    }
    (!coder.is_broken()).then_some(inside)
}
