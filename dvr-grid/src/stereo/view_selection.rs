//! Which views a view is matched with.

use glam::Vec3;

use super::picture::Picture;

/// Views that a view is matched with.
pub(super) const NEIGHBOURS: usize = 4;

/// The angle between lines of sight at which a match is worth most, radians: less, and depth is not sharp; more, and
/// views look at different sides.
const BEST_ANGLE: f32 = 0.21;

/// Beyond this angle nothing is matched, radians: patches are carried by planes that face the camera.
const LARGEST_ANGLE: f32 = 0.6;

/// The best neighbours of each view, best first.
pub(super) fn neighbours(pictures: &[Picture]) -> Vec<Vec<usize>> {
    let toward: Vec<Vec3> = pictures.iter().map(|picture| picture.camera.center.normalize_or_zero()).collect();
    let of = |view: usize| {
        let angle = |other: usize| toward[view].angle_between(toward[other]);
        // How far off the best angle, as a factor.
        let price = |other: usize| (angle(other).max(1e-3) / BEST_ANGLE).ln().abs();
        let mut others: Vec<usize> =
            (0..pictures.len()).filter(|&other| other != view && angle(other) < LARGEST_ANGLE).collect();
        others.sort_by(|&a, &b| price(a).total_cmp(&price(b)));
        others.truncate(NEIGHBOURS);
        others
    };
    (0..pictures.len()).map(of).collect()
}
