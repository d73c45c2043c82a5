//! How much memory it takes to find masks, estimated before it is done.

use dvr_core::View;

use crate::color_model::MODEL_BYTES;
use crate::plane_sweep::SWEPT_PIXEL;
use crate::radiance;
use crate::segment::ROUNDS;
use crate::shrunk::{FINAL_SIZE, WORKING_SIZE};
use crate::within_cube;

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
    let nodes = ROUNDS.iter().map(|round| round.nodes).fold(within_cube::NODES, usize::max) as u64;
    // The masks found before are kept while those learned are drawn.
    views.iter().map(|view| of_view(view) + 2 * of_mask(view)).sum::<u64>()
        + threads * of_thread
        + nodes.pow(3) * NODE
        + radiance::BYTES
}

#[cfg(test)]
mod tests {
    use dvr_core::{Camera, stored};
    use glam::DVec3;
    use image::RgbImage;

    use super::*;

    #[test]
    fn a_view_of_a_million_pixels_takes_eleven_megabytes_and_a_small_one_less() {
        let views = |count: usize, side: u32| -> Vec<View> {
            let picture = stored(RgbImage::new(side, side));
            let camera = Camera::look_at(side, side, f64::from(side), DVec3::Z, DVec3::ZERO, DVec3::Y);
            (0..count).map(|i| View::new(format!("{i}"), camera.clone(), picture.clone(), None)).collect()
        };
        // One thread, whose share does not grow with the views.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let of_one = |side: u32| {
            pool.install(|| memory_estimate(&views(5, side)) - memory_estimate(&views(4, side))) as f64 / 1e6
        };
        assert!((of_one(1000) - 11.0).abs() < 1.0, "{}", of_one(1000));
        assert!((of_one(100) - 7.0).abs() < 0.5, "{}", of_one(100));
    }
}
