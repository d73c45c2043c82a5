//! Which pixels a step follows, and which other views each is compared with: the same on every backend.

use rayon::prelude::*;

use crate::pixel_order::{PixelOrder, mix};
use crate::views::TrainingView;

/// Pixels along the side of what counts as one place.
const TILE: u32 = 8;

/// Rays that a task draws at least.
const CHUNK: usize = 256;

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

/// The `rays` rays of a step that begins after `first` of them, those of a view side by side, and of these what lies
/// close together: it touches the same places in memory.
pub(crate) fn draw_step(
    order: &PixelOrder,
    seed: u64,
    first: u64,
    rays: usize,
    views: &[TrainingView],
) -> Vec<DrawnRay> {
    let of_ray = |ray: usize| {
        let drawn = draw(order, seed, first + ray as u64);
        let width = views[drawn.view as usize].size()[0];
        let [u, v] = [drawn.pixel % width, drawn.pixel / width].map(|at| (at / TILE) as u16);
        // Where a pixel is drawn twice, the seed decides: the order must not depend on how it is sorted.
        ((drawn.view, morton(u, v), drawn.pixel, drawn.seed), drawn)
    };
    let mut keyed: Vec<_> = (0..rays).into_par_iter().with_min_len(CHUNK).map(of_ray).collect();
    keyed.par_sort_unstable_by_key(|&(key, _)| key);
    keyed.into_iter().map(|(_, drawn)| drawn).collect()
}

/// The bits of two numbers in turns (Morton 1966).
fn morton(u: u16, v: u16) -> u32 {
    let spread = |bits: u16| {
        let mut bits = u32::from(bits);
        bits = (bits | bits << 8) & 0x00ff_00ff;
        bits = (bits | bits << 4) & 0x0f0f_0f0f;
        bits = (bits | bits << 2) & 0x3333_3333;
        (bits | bits << 1) & 0x5555_5555
    };
    spread(u) | spread(v) << 1
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    #[test]
    fn a_step_follows_the_rays_that_come_next_those_of_a_view_side_by_side_whatever_the_threads_do() {
        let fixture = Fixture::speckled_ball(0.3, GridLosses::default());
        let key = |ray: &DrawnRay| (ray.view, ray.pixel, ray.seed);
        // More than there are pixels: some are drawn twice.
        let rays = fixture.order.len() + 500;
        let of_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let drawn = pool.install(|| draw_step(&fixture.order, 7, 1000, rays, &fixture.views));
            drawn.iter().map(key).collect::<Vec<_>>()
        };
        let drawn = of_threads(1);
        assert_eq!(drawn, of_threads(3));
        assert!(drawn.is_sorted_by_key(|&(view, ..)| view));
        let mut expected: Vec<_> = (0..rays as u64).map(|ray| key(&draw(&fixture.order, 7, 1000 + ray))).collect();
        let mut all = drawn.clone();
        expected.sort_unstable();
        all.sort_unstable();
        assert_eq!(all, expected);
        // On the way through a view, pixels that follow each other are closer than such as were drawn one after the other.
        let apart = |rays: &[(u32, u32, u64)]| {
            let place = |&(view, pixel, _): &(u32, u32, u64)| {
                let width = fixture.views[view as usize].size()[0];
                (pixel % width, pixel / width)
            };
            let steps = rays.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| {
                let ((u, v), (x, y)) = (place(&pair[0]), place(&pair[1]));
                f64::from(u.abs_diff(x).max(v.abs_diff(y)))
            });
            let steps: Vec<f64> = steps.collect();
            steps.iter().sum::<f64>() / steps.len() as f64
        };
        let mut as_drawn: Vec<_> = (0..rays as u64).map(|ray| key(&draw(&fixture.order, 7, 1000 + ray))).collect();
        as_drawn.sort_by_key(|&(view, ..)| view);
        assert!(apart(&drawn) < 0.5 * apart(&as_drawn), "{} and {}", apart(&drawn), apart(&as_drawn));
    }

    #[test]
    fn the_bits_of_two_numbers_take_turns() {
        assert_eq!(morton(0, 0), 0);
        assert_eq!(morton(0b1011, 0b0110), 0b0110_1101);
        assert_eq!((morton(u16::MAX, 0), morton(0, u16::MAX)), (0x5555_5555, 0xaaaa_aaaa));
    }
}
