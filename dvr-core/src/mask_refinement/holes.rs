//! Holes and bites: parts of the object that a mask leaves out.

use super::classifier::ColorClassifier;
use super::regions::{enclosed_regions, near};

/// Holes larger than this share of the object are left alone.
const LARGEST: f64 = 0.25;

/// Pixels that `object` leaves out of the object, as their indices.
///
/// Looked at is background near the object, and what the object encloses. A pixel is the object's where its colour is
/// nearer to that of the object around it than to any of the background's, and more than half as far from these as
/// the object is there. A few pixels in a row on the outline decide nothing: they may be mixed of both. Where the
/// photograph is itself cut out, what is missing shows the background's colour, and stays.
pub(super) fn missing_pixels(size: [usize; 2], object: &[bool], mixed: &[bool], colors: &[[u8; 3]]) -> Vec<usize> {
    let most = (LARGEST * object.iter().filter(|&&is_object| is_object).count() as f64) as usize;
    let mut closed = object.to_vec();
    let mut holes = enclosed_regions(object, size);
    holes.retain(|hole| hole.len() <= most);
    holes.iter().flatten().for_each(|&pixel| closed[pixel] = true);
    let classifier = ColorClassifier::new(size, object, mixed, near(&closed, size), colors);
    classifier.map_or_else(Vec::new, |classifier| classifier.with_holes(holes).certain_pixels())
}
