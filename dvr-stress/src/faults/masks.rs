//! Errors of masks.

use dvr_core::Mask;
use image::{GrayImage, Luma};
use rand::Rng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Radius of a hole, pixels.
const HOLE: f64 = 2.5;

/// How far a wrong mask is moved, in frames.
const ASIDE: f64 = 0.4;

fn mask_where(size: (u32, u32), is_object: impl Fn(u32, u32) -> bool) -> Mask {
    Mask::from(GrayImage::from_fn(size.0, size.1, |u, v| Luma([if is_object(u, v) { 255 } else { 0 }])))
}

/// The offsets of pixels within a distance.
fn disc(radius: f64) -> Vec<(i64, i64)> {
    let reach = radius.ceil() as i64;
    let within = |&(x, y): &(i64, i64)| ((x * x + y * y) as f64).sqrt() <= radius;
    (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y))).filter(within).collect()
}

/// The mask grown by this many pixels on all sides, or shrunk where it is negative. The frame's border does not shrink
/// it.
pub(super) fn grown(mask: &Mask, pixels: f64) -> Mask {
    if pixels == 0.0 {
        return mask.clone();
    }
    let (width, height) = mask.size();
    let offsets = disc(pixels.abs());
    let looks_for = pixels > 0.0;
    mask_where((width, height), |u, v| {
        let found = offsets.iter().any(|&(x, y)| {
            let (x, y) = (i64::from(u) + x, i64::from(v) + y);
            let inside = x >= 0 && y >= 0 && x < i64::from(width) && y < i64::from(height);
            inside && mask.is_object(x as u32, y as u32) == looks_for
        });
        found == looks_for
    })
}

/// Punches round holes until this share of the object's pixels is gone.
pub(super) fn punch(mask: &mut Mask, share: f64, rng: &mut ChaCha8Rng) {
    let (width, height) = mask.size();
    let mut object: Vec<(u32, u32)> =
        (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).filter(|&(u, v)| mask.is_object(u, v)).collect();
    let keep = ((1.0 - share) * object.len() as f64).round() as usize;
    object.shuffle(rng);
    let mut left = object.len();
    let offsets = disc(HOLE);
    for (u, v) in object {
        for &(x, y) in &offsets {
            if left <= keep {
                return;
            }
            let (x, y) = (i64::from(u) + x, i64::from(v) + y);
            if x >= 0 && y >= 0 && x < i64::from(width) && y < i64::from(height) && mask.is_object(x as u32, y as u32) {
                mask.coverage.put_pixel(x as u32, y as u32, Luma([0]));
                left -= 1;
            }
        }
    }
}

/// Flips each pixel with this probability.
pub(super) fn speckle(mask: &mut Mask, share: f64, rng: &mut ChaCha8Rng) {
    for pixel in mask.coverage.pixels_mut() {
        if rng.random_bool(share.clamp(0.0, 1.0)) {
            pixel.0[0] = 255 - pixel.0[0];
        }
    }
}

/// A wrong mask: the same outline elsewhere in the frame.
pub(super) fn moved_aside(mask: &Mask) -> Mask {
    let (width, height) = mask.size();
    let shift = (ASIDE * f64::from(width)).round() as u32;
    mask_where((width, height), |u, v| mask.is_object((u + shift) % width, v))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn square() -> Mask {
        mask_where((40, 40), |u, v| (10..30).contains(&u) && (10..30).contains(&v))
    }

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(3)
    }

    #[test]
    fn masks_grow_and_shrink_by_whole_pixels() {
        for pixels in [1.0, 2.0, 4.0] {
            let k = pixels as u32;
            let larger = grown(&square(), pixels);
            assert!(larger.is_object(10 - k, 20) && !larger.is_object(10 - k - 1, 20));
            let smaller = grown(&square(), -pixels);
            assert_eq!(smaller.object_pixels(), (20 - 2 * k as usize).pow(2));
        }
        assert_eq!(grown(&square(), 0.0), square());
    }

    #[test]
    fn holes_take_their_share_and_nothing_outside() {
        let mut mask = square();
        punch(&mut mask, 0.2, &mut rng());
        assert_eq!(mask.object_pixels(), 320);
        assert!((0..40).all(|i| !mask.is_object(i, 0)));
    }

    #[test]
    fn speckle_flips_its_share_of_both_kinds() {
        let mut mask = mask_where((100, 100), |u, _| u < 50);
        speckle(&mut mask, 0.1, &mut rng());
        let turned = |object: bool| {
            let all = (0..100u32).flat_map(|v| (0..100u32).map(move |u| (u, v)));
            all.filter(|&(u, v)| (u < 50) == object && mask.is_object(u, v) != object).count()
        };
        assert!(turned(true).abs_diff(500) < 80 && turned(false).abs_diff(500) < 80);
    }

    #[test]
    fn a_mask_moved_aside_shows_little_of_the_object() {
        let (right, wrong) = (square(), moved_aside(&square()));
        let shared = (0..40).flat_map(|v| (0..40).map(move |u| (u, v)));
        let shared = shared.filter(|&(u, v)| right.is_object(u, v) && wrong.is_object(u, v)).count();
        assert!(wrong.object_pixels() == 400 && shared <= 100, "{shared}");
    }
}
