//! The occupancy bitmask, which cells rays need not look at, inside kernels: the counterpart of `crate::occupancy`.

#![allow(missing_docs)]

use burn::tensor::IntDType;
use cubecl::prelude::*;
use dvr_gpu::{Buffer, Buffers, DeviceError};

use super::launch::{groups, units};

/// Words per row of nodes.
#[cube]
pub(crate) fn words(nodes: u32) -> u32 {
    (nodes - 1u32) / 32u32 + 1u32
}

/// Whether each node is not negative, a bit each, in rows of whole words.
#[cube(launch)]
pub(crate) fn signs(values: &[f32], inside: &mut [u32], nodes: u32) {
    let words = words(nodes);
    let at = ABSOLUTE_POS as u32;
    if at < words * nodes * nodes {
        let (first, row) = (at % words * 32u32, at / words);
        let mut bits = 0u32;
        for bit in 0..32u32 {
            let x = first + bit;
            if x < nodes && values[(row * nodes + x) as usize] >= 0.0f32 {
                bits |= 1u32 << bit;
            }
        }
        inside[at as usize] = bits;
    }
}

/// Brings the bits of the active nodes up to date, in rows of whole words: whether their values are not negative.
#[cube(launch)]
pub(crate) fn sign(active: &[u32], values: &[f32], inside: &mut [Atomic<u32>], count: u32, nodes: u32) {
    let slot = ABSOLUTE_POS;
    if slot < count as usize {
        let node = active[slot];
        let words = words(nodes);
        let x = node % nodes;
        let word = (node / nodes * words + x / 32u32) as usize;
        let bit = 1u32 << (x % 32u32);
        if values[node as usize] >= 0.0f32 {
            inside[word].fetch_or(bit);
        } else {
            inside[word].fetch_and(!bit);
        }
    }
}

/// From nodes to cells, a word each: whether one of a cell's corners is not negative.
#[cube(launch)]
pub(crate) fn mark(inside: &[u32], marks: &mut [u32], nodes: u32) {
    let words = words(nodes);
    let cells = nodes - 1u32;
    let at = ABSOLUTE_POS as u32;
    if at < words * cells * cells {
        let (word, y, z) = (at % words, at / words % cells, at / (words * cells));
        let here = any(inside, word, y, z, nodes, words);
        let mut next = 0u32;
        if word + 1u32 < words {
            next = any(inside, word + 1u32, y, z, nodes, words) << 31u32;
        }
        marks[at as usize] = here | (here >> 1u32) | next;
    }
}

/// The nodes of a word in the four rows around a row of cells, together.
#[cube]
fn any(inside: &[u32], word: u32, y: u32, z: u32, nodes: u32, words: u32) -> u32 {
    let first = (z * nodes + y) * words + word;
    let above = first + nodes * words;
    inside[first as usize]
        | inside[(first + words) as usize]
        | inside[above as usize]
        | inside[(above + words) as usize]
}

/// Whether each of these values is not negative, a bit each, in rows of whole words.
///
/// # Errors
/// When there is no room for them.
pub(crate) fn signs_of(buffers: &Buffers, values: &Buffer, nodes: usize) -> Result<Buffer, DeviceError> {
    let count = nodes.div_ceil(32) * nodes * nodes;
    let inside = buffers.zeros("signs of nodes", count, IntDType::U32)?;
    signs::launch(
        &buffers.client,
        groups(&buffers.client, count),
        units(),
        values.clone().into_buffer_arg(),
        inside.clone().into_buffer_arg(),
        nodes as u32,
    );
    Ok(inside)
}

/// Room for the marks of the cells of a grid of `nodes` nodes along an edge.
///
/// # Errors
/// When there is none.
pub(crate) fn marks_of(buffers: &Buffers, nodes: usize) -> Result<Buffer, DeviceError> {
    buffers.zeros("marks of cells", nodes.div_ceil(32) * (nodes - 1).pow(2), IntDType::U32)
}

/// Marks the cells between nodes with these signs.
pub(crate) fn update(buffers: &Buffers, inside: &Buffer, marks: &Buffer, nodes: usize) {
    let client = &buffers.client;
    mark::launch(
        client,
        groups(client, nodes.div_ceil(32) * (nodes - 1).pow(2)),
        units(),
        inside.clone().into_buffer_arg(),
        marks.clone().into_buffer_arg(),
        nodes as u32,
    );
}
