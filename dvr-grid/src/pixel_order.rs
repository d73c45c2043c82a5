//! In which order the pixels of all photographs are drawn.

use dvr_core::hull::MaskDistance;
use rayon::prelude::*;

use crate::views::TrainingView;

/// The pixels to learn from, in an order that visits each once before any twice.
#[derive(Clone, Debug)]
pub(crate) struct PixelOrder {
    /// Runs of neighbouring pixels, view after view: how many pixels come before, view, index of the first pixel.
    runs: Vec<(u64, u32, u32)>,
    total: u64,
    stride: u64,
}

impl PixelOrder {
    /// Takes the pixels of each mask and those within `margin` of it. Views are shrunk by `factor`; `masks` and `margin`
    /// count pixels of their full size.
    pub fn new(
        views: &[TrainingView],
        factor: u32,
        masks: &[MaskDistance],
        margin: impl Fn(usize) -> f32 + Sync,
    ) -> Self {
        let of_view = |(i, (view, mask)): (usize, (&TrainingView, &MaskDistance))| {
            let [width, height] = view.size();
            let margin = margin(i);
            let near = |&index: &u32| {
                let (u, v) = (index % width, index / width);
                let of_middle = |at: u32| factor * at + factor / 2;
                view.is_object(u, v) || mask.of_pixel(of_middle(u), of_middle(v)) > -margin
            };
            let mut runs: Vec<(u32, u32)> = Vec::new();
            for index in (0..width * height).filter(near) {
                match runs.last_mut() {
                    Some((first, length)) if *first + *length == index => *length += 1,
                    _ => runs.push((index, 1)),
                }
            }
            runs
        };
        let of_views: Vec<Vec<(u32, u32)>> = views.par_iter().zip(masks).enumerate().map(of_view).collect();
        let (mut runs, mut total) = (Vec::new(), 0);
        for (view, of_view) in (0..).zip(of_views) {
            for (first, length) in of_view {
                runs.push((total, view, first));
                total += u64::from(length);
            }
        }
        Self { runs, total, stride: coprime_near(0.618_034 * total as f64, total) }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.total as usize
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.total == 0
    }

    /// The view and pixel index that come `count`th; `seed` shifts each pass through the pixels.
    pub fn pick(&self, count: u64, seed: u64) -> (u32, u32) {
        let total = self.total;
        let (pass, within) = (count / total, count % total);
        let shift = mix(seed ^ pass.wrapping_mul(0x9e37_79b9_7f4a_7c15)) % total;
        let index = ((u128::from(within) * u128::from(self.stride) + u128::from(shift)) % u128::from(total)) as u64;
        let (before, view, first) = self.runs[self.runs.partition_point(|&(before, ..)| before <= index) - 1];
        (view, first + (index - before) as u32)
    }
}

/// The number near `wanted` that has no factor in common with `total`.
fn coprime_near(wanted: f64, total: u64) -> u64 {
    let gcd = |mut a: u64, mut b: u64| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    (wanted as u64..).find(|&n| gcd(n.max(1), total.max(1)) == 1).unwrap_or(1).max(1)
}

/// A hash whose outputs look random (Steele et al. 2014, SplitMix64).
pub(crate) fn mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
