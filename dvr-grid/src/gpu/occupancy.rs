//! The occupancy bitmask, which cells rays need not look at, inside kernels: the counterpart of `crate::occupancy`.

#![allow(missing_docs)]

use cubecl::prelude::*;

/// Words per row of nodes.
#[cube]
pub(crate) fn words(nodes: u32) -> u32 {
    (nodes - 1u32) / 32u32 + 1u32
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

/// Whether each node is not negative, a bit each, in rows of whole words.
pub(crate) fn bits(nodes: usize, values: &[f32]) -> Vec<u32> {
    let rows = values.chunks(nodes).flat_map(|row| row.chunks(32));
    rows.map(|run| run.iter().zip(0..).fold(0, |word, (value, bit)| word | u32::from(*value >= 0.0) << bit)).collect()
}
