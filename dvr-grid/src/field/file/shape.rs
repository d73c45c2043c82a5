//! The occupancy at the corners of cells that the surface passes through, as steps of a quantiser.
//!
//! Shapes are almost linear from node to node: a value is predicted by several planes and lines through those before it
//! (among them the Lorenzo predictor, Ibarria et al. 2003), and what is left is coded by how far these agree.

use dvr_core::voxel::VoxelGrid;

use super::coder::{Coder, NumberModel};
use crate::bricks::NodeSet;

/// Layers of nodes that predictions look back to, the present one among them.
const LAYERS: usize = 3;

/// Nodes before one, by their offsets, each with a factor.
type Terms = &'static [(i32, [isize; 3])];

/// Sums of values before a node, with their weights among each other: by the spread of what they leave on shapes that
/// were learned from photographs. They, and what follows, are part of the format.
const PREDICTORS: [(i32, Terms); 10] = [
    (5, &[(2, [-1, 0, 0]), (-1, [-2, 0, 0])]),
    (5, &[(2, [0, -1, 0]), (-1, [0, -2, 0])]),
    (5, &[(2, [0, 0, -1]), (-1, [0, 0, -2])]),
    (8, &[(1, [-1, 0, 0]), (1, [0, -1, 0]), (-1, [-1, -1, 0])]),
    (8, &[(1, [-1, 0, 0]), (1, [0, 0, -1]), (-1, [-1, 0, -1])]),
    (8, &[(1, [0, -1, 0]), (1, [0, 0, -1]), (-1, [0, -1, -1])]),
    (
        8,
        &[
            (1, [-1, 0, 0]),
            (1, [0, -1, 0]),
            (1, [0, 0, -1]),
            (-1, [-1, -1, 0]),
            (-1, [-1, 0, -1]),
            (-1, [0, -1, -1]),
            (1, [-1, -1, -1]),
        ],
    ),
    (4, &[(1, [1, -1, 0]), (1, [-1, 0, 0]), (-1, [0, -1, 0])]),
    (4, &[(1, [1, 0, -1]), (1, [-1, 0, 0]), (-1, [0, 0, -1])]),
    (4, &[(1, [0, 1, -1]), (1, [0, -1, 0]), (-1, [0, 0, -1])]),
];

/// How far predictors are apart, in quantiser steps, less than this in each of the classes but the last two.
const APART: [i32; 5] = [1, 2, 4, 8, 16];

/// Classes of predictions: by how far they are apart, and without any.
const CLASSES: usize = APART.len() + 2;

/// Sizes of predictions that are told apart: near the surface, less is left below them.
const SIZES: usize = 8;

/// Codes the steps of the nodes of `stored`, in their order, of which `inside` says on which side they are. A reader
/// ignores `given`; `None` where it comes to the end of its stream before.
pub(super) fn code_steps(
    coder: &mut impl Coder,
    grid: &VoxelGrid,
    stored: &NodeSet,
    inside: &NodeSet,
    given: impl Fn([usize; 3]) -> i8,
) -> Option<Vec<i8>> {
    let mut models = vec![NumberModel::default(); CLASSES * SIZES];
    let mut before = Before { stored, nodes: grid.nodes(), steps: vec![0; LAYERS * grid.nodes().pow(2)] };
    let mut code = |at: [usize; 3]| {
        if coder.is_broken() {
            return None;
        }
        let is_inside = inside.contains(at);
        // Steps 0 and up are inside, -1 and down outside.
        let size_of = |step: i32| if is_inside { step } else { -1 - step };
        let (predicted, class) = before.predict(at);
        let predicted = size_of(predicted).clamp(0, 127);
        let model = &mut models[class * SIZES + (predicted as usize).min(SIZES - 1)];
        let left = model.code(coder, size_of(i32::from(given(at))) - predicted);
        let size = (predicted + left).clamp(0, 127);
        let step = if is_inside { size } else { -1 - size } as i8;
        before.learn(at, step);
        Some(step)
    };
    stored.iter().map(&mut code).collect()
}

/// The steps of nodes that were coded.
struct Before<'a> {
    /// Which nodes have one, once it is their turn.
    stored: &'a NodeSet,
    nodes: usize,
    /// Of the nodes of some layers: nothing that lies further back is asked for.
    steps: Vec<i8>,
}

impl Before<'_> {
    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z % LAYERS * self.nodes + y) * self.nodes + x
    }

    /// A step that may lie beyond the grid, or not be stored.
    fn step(&self, at: [isize; 3]) -> Option<i32> {
        self.stored.has(at).then(|| i32::from(self.steps[self.index(at.map(|at| at as usize))]))
    }

    /// A prediction, and its class.
    fn predict(&self, at: [usize; 3]) -> (i32, usize) {
        let at = at.map(|at| at as isize);
        let near = |[x, y, z]: [isize; 3]| self.step([at[0] + x, at[1] + y, at[2] + z]);
        let sum =
            |terms: &[(i32, [isize; 3])]| terms.iter().try_fold(0, |sum, &(factor, by)| Some(sum + factor * near(by)?));
        let mut found = [(0, 0); PREDICTORS.len()];
        for (found, (weight, terms)) in found.iter_mut().zip(PREDICTORS) {
            *found = sum(terms).map_or((0, 0), |guess| (weight, guess));
        }
        let weights: i32 = found.iter().map(|(weight, _)| weight).sum();
        if weights == 0 {
            let beside = [[-1, 0, 0], [0, -1, 0], [0, 0, -1]].into_iter().find_map(near);
            return (beside.unwrap_or(0), CLASSES - 1);
        }
        let weighted: i32 = found.iter().map(|(weight, guess)| weight * guess).sum();
        let guess = (weighted + weights / 2).div_euclid(weights);
        let apart = found.iter().filter(|(weight, _)| *weight > 0).map(|(_, other)| (other - guess).abs()).max();
        let apart = apart.unwrap_or(0);
        (guess, APART.iter().take_while(|&&most| apart >= most).count())
    }

    fn learn(&mut self, at: [usize; 3], step: i8) {
        let index = self.index(at);
        self.steps[index] = step;
    }
}
