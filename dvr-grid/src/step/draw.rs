//! Which pixels a step follows, and which other views each is compared with: the same on every backend.

use crate::pixel_order::{PixelOrder, mix};

/// A ray that a step draws.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DrawnRay {
    pub view: u32,
    /// Index of the pixel in its picture.
    pub pixel: u32,
    /// Chooses the views that it is compared with.
    pub seed: u64,
}

/// The ray that comes `count`th in a run.
pub(crate) fn draw(order: &PixelOrder, seed: u64, count: u64) -> DrawnRay {
    let (view, pixel) = order.pick(count, seed);
    DrawnRay { view, pixel, seed: mix(seed ^ mix(count)) }
}

/// The views that a ray is compared with: at most `count` of the neighbours, as `seed` chooses.
pub(crate) fn compared(neighbours: &[u32], count: usize, seed: u64) -> impl Iterator<Item = u32> {
    let first = mix(seed) as usize;
    (0..count.min(neighbours.len())).map(move |k| {
        // Different views: the second lies this many places after the first.
        let step = if k == 0 { 0 } else { 1 + (mix(seed ^ k as u64) as usize) % (neighbours.len() - 1) };
        neighbours[(first + step) % neighbours.len()]
    })
}
