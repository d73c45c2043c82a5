//! How much memory it takes to find masks, estimated before it is done.

use dvr_core::View;

use crate::color_model::MODEL_BYTES;
use crate::plane_sweep::SWEPT_PIXEL;
use crate::segment::{FINAL_SIZE, NODES, WORKING_SIZE};

/// Bytes of a pixel of a working picture: its colour, what depths say, prices of edges, what belongs to the object, distances.
const WORKING_PIXEL: u64 = 64;

/// The same of a picture in which an outline is drawn at last, with the solver.
const FINAL_PIXEL: u64 = 80;

/// Bytes of a node of the volume: its price and what it may be, and the solver.
const NODE: u64 = 48;

/// Bytes that [`segment`](crate::segment()) takes at most, about, beside the photographs.
pub fn memory_estimate(views: &[View]) -> u64 {
    let threads = (rayon::current_num_threads() as u64).min(views.len() as u64);
    let pixels = |view: &View, longest: u32| {
        let (width, height) = view.image.dimensions();
        let scale = (f64::from(longest) / f64::from(width.max(height).max(1))).min(1.0);
        (f64::from(width) * f64::from(height) * scale * scale).ceil() as u64
    };
    let largest = |longest| views.iter().map(|view| pixels(view, longest)).max().unwrap_or(0);
    // Colours are learned while those of the round before are still there.
    let of_view = |view: &View| 2 * MODEL_BYTES + pixels(view, WORKING_SIZE) * WORKING_PIXEL;
    let of_mask = |view: &View| u64::from(view.image.width()) * u64::from(view.image.height());
    let of_thread = (largest(WORKING_SIZE) * SWEPT_PIXEL).max(largest(FINAL_SIZE) * FINAL_PIXEL).max(4 * MODEL_BYTES);
    let nodes = NODES.into_iter().max().unwrap_or(0) as u64;
    views.iter().map(|view| of_view(view) + of_mask(view)).sum::<u64>() + threads * of_thread + nodes.pow(3) * NODE
}
