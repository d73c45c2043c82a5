//! Rims: background along the outline of a mask that is too wide.

use super::classifier::{ColorClassifier, MOST};
use super::regions::near;

/// Pixels of a rim of background along the object's outline, as their indices; none unless it goes around most of the
/// outline.
///
/// A rim shows the background around it and no colour of the object's inside, along most of the outline: a highlight is
/// no background.
pub(super) fn rim_pixels(size: [usize; 2], background: &[bool], mixed: &[bool], colors: &[[u8; 3]]) -> Vec<usize> {
    let Some(classifier) = ColorClassifier::new(size, background, mixed, near(background, size), colors) else {
        return Vec::new();
    };
    let rim = classifier.certain_pixels();
    if is_most_of_the_outline(&classifier, &rim) { rim } else { Vec::new() }
}

/// Whether `with_rims` masks are half of those looked at, or more.
pub(super) fn are_common(with_rims: usize, looked_at: usize) -> bool {
    with_rims > 0 && 2 * with_rims >= looked_at
}

/// Whether most of the pixels in question that touch the background are among `pixels`.
fn is_most_of_the_outline(classifier: &ColorClassifier, pixels: &[usize]) -> bool {
    let mut chosen = vec![false; classifier.known.len()];
    pixels.iter().for_each(|&pixel| chosen[pixel] = true);
    let touches = |&&pixel: &&usize| classifier.around(pixel, 1).any(|near| classifier.known[near]);
    let outline: Vec<usize> = classifier.candidates.iter().filter(touches).copied().collect();
    let found = outline.iter().filter(|&&pixel| chosen[pixel]).count();
    found as f64 > MOST * outline.len() as f64
}
