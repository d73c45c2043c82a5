//! One mask of two that were found in different ways.

use dvr_core::{Mask, signed_distance, stored};
use image::{GrayImage, Luma};

use crate::shrunk::FINAL_SIZE;

/// Differences up to twice as wide as this are rims, as a share of the picture's longer side: about a cell of what is learned.
const RIM: f32 = 0.0075;

/// The first mask, but for places where the other differs by more than a rim: outlines are finer in the first, and what it has
/// too much or too little is right in the other. Both are as large as their picture.
pub(crate) fn merged(fine: &Mask, coarse: &Mask) -> Mask {
    let (width, height) = fine.coverage.dimensions();
    // Both were drawn in pictures no larger than this, which bounds what the distances take.
    let scale = (FINAL_SIZE as f32 / width.max(height) as f32).min(1.0);
    let [across, down] = [width, height].map(|side| ((scale * side as f32).round() as u32).max(1));
    let differs = |pixel: u32| {
        let [u, v] = [(pixel % across) * width / across, (pixel / across) * height / down];
        fine.is_object(u, v) != coarse.is_object(u, v)
    };
    let differs: Vec<bool> = (0..across * down).map(differs).collect();
    let wide = wide(&differs, across as usize);
    if !wide.contains(&true) {
        return fine.clone();
    }
    let pixel = |u: u32, v: u32| {
        let small = (v * down / height) * across + u * across / width;
        let mask = if wide[small as usize] { coarse } else { fine };
        Luma([mask.coverage.get_pixel(u, v)[0]])
    };
    Mask { coverage: stored(GrayImage::from_fn(width, height, pixel)) }
}

/// Pixels of differences that are wider than a rim, with all that is up to their edges.
pub(crate) fn wide(differs: &[bool], width: usize) -> Vec<bool> {
    let reach = RIM * width.max(differs.len() / width) as f32;
    let is_deep: Vec<bool> = signed_distance(differs, width).iter().map(|depth| *depth >= reach).collect();
    // What is nowhere deep is infinitely far from it.
    signed_distance(&is_deep, width).iter().map(|deep| *deep > -reach - 1.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 pixels wide: a rim is 1.5 pixels.
    fn mask(is_object: impl Fn(u32, u32) -> bool) -> Mask {
        Mask::from(GrayImage::from_fn(200, 100, |u, v| Luma([if is_object(u, v) { 255 } else { 0 }])))
    }

    #[test]
    fn rims_stay_and_what_is_thicker_is_taken_from_the_other() {
        let square = |u: u32, v: u32| (50..150).contains(&u) && (20..80).contains(&v);
        let fine = mask(square);
        // A rim too narrow on all sides, a piece that is missing, and one that is too much.
        let gap = |u: u32, v: u32| (90..110).contains(&u) && (60..80).contains(&v);
        let horn = |u: u32, v: u32| (60..70).contains(&u) && (5..22).contains(&v);
        let coarse = mask(|u, v| {
            let is_within = (52..148).contains(&u) && (22..78).contains(&v);
            (is_within && !gap(u, v)) || horn(u, v)
        });
        let merged = merged(&fine, &coarse);
        assert!(!merged.is_object(100, 70) && merged.is_object(65, 12), "pieces are the other's");
        assert!(merged.is_object(50, 50) && merged.is_object(149, 50) && merged.is_object(130, 20), "rims stay");
        let narrow = mask(|u, v| (52..148).contains(&u) && (22..78).contains(&v));
        assert_eq!(super::merged(&fine, &narrow), fine);
    }
}
