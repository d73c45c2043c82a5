//! From lessons at points to gradients at nodes.

use dvr_kernels::{ActiveNodes, Cell, Lattice};
use rayon::prelude::*;

use super::rays::Lesson;

/// Layers of nodes that one task gathers.
const LAYERS: usize = 4;

/// Adds up what lessons say of the shape at each active node; `gradient` is overwritten there.
///
/// Each task owns some layers and reads all lessons, so sums have one order whatever the threads do.
pub(super) fn gather_shape(lessons: &[Lesson], active: &ActiveNodes, is_active: &[bool], gradient: &mut [f32]) {
    gather::<1>(
        lessons,
        active,
        is_active,
        gradient,
        |lesson| lesson.shape_cell,
        |lesson| lesson.shape_cell.weights().map(|weight| [weight * lesson.by_value]),
    );
}

/// The same for the colour.
pub(super) fn gather_color(lessons: &[Lesson], active: &ActiveNodes, is_active: &[bool], gradient: &mut [f32]) {
    let corners = |lesson: &Lesson| lesson.color_cell.weights().map(|weight| (weight * lesson.by_color).to_array());
    gather::<3>(lessons, active, is_active, gradient, |lesson| lesson.color_cell, corners);
}

fn gather<const C: usize>(
    lessons: &[Lesson],
    active: &ActiveNodes,
    is_active: &[bool],
    gradient: &mut [f32],
    cell: impl Fn(&Lesson) -> Cell + Sync,
    corners: impl Fn(&Lesson) -> [[f32; C]; 8] + Sync,
) {
    let lattice: &Lattice = active.lattice();
    let plane = lattice.nodes() * lattice.nodes();
    let offsets = lattice.corner_offsets();
    gradient.par_chunks_mut(LAYERS * plane * C).enumerate().for_each(|(task, gradient)| {
        let layer = task * LAYERS;
        let nodes = layer * plane..layer * plane + gradient.len() / C;
        for z in layer..(layer + LAYERS).min(lattice.nodes()) {
            for &(start, length) in active.layer(z) {
                let start = (start as usize - nodes.start) * C;
                gradient[start..start + length as usize * C].fill(0.0);
            }
        }
        for lesson in lessons {
            let first = cell(lesson).node;
            if first + offsets[7] < nodes.start || first >= nodes.end {
                continue;
            }
            for (offset, value) in offsets.iter().zip(corners(lesson)) {
                let node = first + offset;
                if nodes.contains(&node) && is_active[node] {
                    let at = (node - nodes.start) * C;
                    (0..C).for_each(|c| gradient[at + c] += value[c]);
                }
            }
        }
    });
}
