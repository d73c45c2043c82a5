//! What can be wrong with photographs that are otherwise easy.

mod cameras;
mod masks;

use dvr_core::Camera;
use dvr_core::synth::Shot;
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
    /// Share of all pixels whose mask says the opposite.
    pub speckle: f64,
    /// Masks that show something else altogether: they are moved aside by 40 % of the frame.
    pub wrong_masks: usize,
    /// Degrees by which each camera is turned from what is said of it, about an axis of its own.
    pub rotation: f64,
    /// How far each camera stands from where it is said to, in shares of its distance, in a direction of its own.
    pub translation: f64,
    /// Error of the focal length, as a share; of one sign in half of the views, of the other in the rest.
    pub focal: f64,
    /// How far off the middle of the frame the object is, in frames: at a half, its middle lies on the border.
    pub aside: f64,
}

/// Views that `dvr train` holds out where the dataset does not say: one in eight, the middle one. Wrong masks are put
/// elsewhere, or they would do no harm.
const HELD_OUT: (usize, usize) = (8, 4);

impl Faults {
    /// Whether cameras are not where they are said to be.
    pub fn displace_cameras(&self) -> bool {
        self.rotation != 0.0 || self.translation != 0.0 || self.focal != 0.0
    }

    /// Where the cameras really point.
    pub(crate) fn aim(&self, cameras: &mut [Camera], seed: u64) {
        for (view, camera) in cameras.iter_mut().enumerate().filter(|_| self.aside > 0.0) {
            cameras::look_aside(camera, self.aside, &mut rng(seed, view, 1));
        }
    }

    /// What is said of the pictures.
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

/// Moves a camera by a share of its distance from the origin, then turns it on the spot by so many degrees, each in or
/// about a random direction.
pub fn displace_camera(camera: &mut Camera, degrees: f64, share: f64, rng: &mut ChaCha8Rng) {
    cameras::shift(camera, share, rng);
    cameras::turn(camera, degrees, rng);
}

/// Evenly spread views among those that are trained on.
pub(crate) fn wrong_views(views: usize, wrong: usize) -> Vec<usize> {
    let (every, held) = HELD_OUT;
    let eligible: Vec<usize> = (0..views).filter(|view| view % every != held).collect();
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
            assert!(views.iter().all(|view| view % 8 != 4), "{views:?}");
            assert!(views.windows(2).all(|pair| pair[0] < pair[1]));
        }
    }
}
