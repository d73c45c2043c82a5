//! Faults of masks and cameras.

mod cameras;
mod masks;

use dvr_core::synth::Shot;
use dvr_core::{Camera, HOLD_OUT_EVERY, HeldOut};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Faults of masks and cameras, and of where the cameras point; all zero is none. (Noise and exposure are the
/// renderer's: [`dvr_core::synth::SynthConfig`].)
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Faults {
    /// Pixels by which masks are too large; negative, too small.
    pub grown_masks: f64,
    /// Share of each mask that is lost to round holes.
    pub holes: f64,
    /// Share of all pixels whose mask is flipped.
    pub speckle: f64,
    /// Number of wrong masks: they are moved by 40 % of the frame.
    pub wrong_masks: usize,
    /// Rotation error of each camera about a random axis, degrees.
    pub rotation: f64,
    /// Position error of each camera in a random direction, as a share of its distance.
    pub translation: f64,
    /// Error of the focal length, as a share; positive in half of the views, negative in the others.
    pub focal: f64,
    /// How far the object is from the centre of the frame, in frames: at a half, its centre lies on the border.
    pub aside: f64,
}

impl Faults {
    /// Whether the stated cameras are wrong.
    pub fn displace_cameras(&self) -> bool {
        self.rotation != 0.0 || self.translation != 0.0 || self.focal != 0.0
    }

    /// Aims the cameras from which pictures are rendered.
    pub(crate) fn aim(&self, cameras: &mut [Camera], seed: u64) {
        for (view, camera) in cameras.iter_mut().enumerate().filter(|_| self.aside > 0.0) {
            cameras::look_aside(camera, self.aside, &mut rng(seed, view, 1));
        }
    }

    /// Applies the faults to what is stated of the pictures: cameras and masks.
    pub(crate) fn spoil(&self, shots: &mut [Shot], seed: u64) {
        for (view, shot) in shots.iter_mut().enumerate() {
            cameras::turn(&mut shot.camera, self.rotation, &mut rng(seed, view, 2));
            cameras::shift(&mut shot.camera, self.translation, &mut rng(seed, view, 3));
            let sign = if view % 2 == 0 { 1.0 } else { -1.0 };
            cameras::zoom(&mut shot.camera, 1.0 + sign * self.focal);
            let mask = &mut shot.picture.mask;
            *mask = masks::grown(mask, self.grown_masks);
            masks::punch(mask, self.holes, &mut rng(seed, view, 4));
            masks::speckle(mask, self.speckle, &mut rng(seed, view, 5));
        }
        for view in wrong_views(shots.len(), self.wrong_masks) {
            let mask = &mut shots[view].picture.mask;
            *mask = masks::moved_aside(mask);
        }
    }
}

/// Moves a camera by a share of its distance from the origin in a random direction, then rotates it about its centre by
/// `degrees` about a random axis.
pub fn displace_camera(camera: &mut Camera, degrees: f64, share: f64, rng: &mut ChaCha8Rng) {
    cameras::shift(camera, share, rng);
    cameras::turn(camera, degrees, rng);
}

/// Views with wrong masks: evenly spread among those that are trained on with default settings.
pub(crate) fn wrong_views(views: usize, wrong: usize) -> Vec<usize> {
    let HeldOut { validation, test } = HeldOut::of(views, HOLD_OUT_EVERY);
    let eligible: Vec<usize> = (0..views).filter(|view| !validation.contains(view) && !test.contains(view)).collect();
    let wrong = wrong.min(eligible.len());
    (0..wrong).map(|i| eligible[(2 * i + 1) * eligible.len() / (2 * wrong)]).collect()
}

/// Random numbers of one fault of one view: faults do not depend on each other.
fn rng(seed: u64, view: usize, fault: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(8 * view as u64 + fault);
    rng
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_masks_are_in_views_that_are_trained_on() {
        for wrong in [0, 1, 3, 8] {
            let views = wrong_views(24, wrong);
            assert_eq!(views.len(), wrong);
            assert!(views.iter().all(|view| view % 8 != 4 && view % 16 != 8), "{views:?}");
            assert!(views.windows(2).all(|pair| pair[0] < pair[1]));
        }
    }
}
