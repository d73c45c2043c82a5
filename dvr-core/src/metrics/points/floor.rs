//! The points' own noise: what even the true surface would score.

use glam::{DMat3, DVec3};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::distance::quantile;
use crate::triangulation::{Sighting, triangulate};
use crate::verified_points::{TrackSight, Tracks};

/// Views that a track needs to be split in two that can be triangulated.
const SHORTEST_TRACK: usize = 4;

/// The median of `|x|` of a normal distribution with standard deviation 1.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;

/// What the points would score against the true surface, estimated from themselves: each track is split at random into
/// two halves of equal length, and these are triangulated apart.
///
/// The distance between the two is that of two independent errors. It is scaled to the error of the whole track by
/// what the views' geometry says of both (their covariances). Of the error, the part along the mean line of sight
/// counts, as if the surface faced the cameras: it is the largest part, and a surface that is turned away has a lower
/// floor.
///
/// Assumed: errors of features are independent and of equal size in all views of a track. What views share is not seen:
/// errors of cameras, and matches that are wrong in all of them. The true floor is higher for that.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointsFloor {
    /// Points with tracks of four views or more, from which the floor is known.
    pub points: usize,
    /// The mean distance that the true surface would score, in the units of the files.
    pub mean: f64,
    /// The median.
    pub median: f64,
    /// 90 % of the points are at most this far.
    pub quantile_90: f64,
    /// Standard deviation of features, in pixels and each direction, by the median point.
    pub feature_px: f64,
}

/// The floor of tracks whose pictures of the points are known; `None` where none is long enough.
pub(super) fn points_floor(tracks: &Tracks, seed: u64) -> Option<PointsFloor> {
    let of_track = |(index, sights): (usize, &Vec<TrackSight>)| {
        let sighting =
            |sight: &TrackSight| Some(Sighting { camera: tracks.cameras.get(sight.camera)?, bearing: sight.bearing? });
        let mut sightings: Vec<Sighting> = sights.iter().filter_map(sighting).collect();
        sightings.shuffle(&mut ChaCha8Rng::seed_from_u64(seed.wrapping_add(index as u64)));
        split_error(&sightings)
    };
    let errors: Vec<SplitError> = tracks.sights.par_iter().enumerate().filter_map(of_track).collect();
    if errors.is_empty() {
        return None;
    }
    let ascending = |part: fn(&SplitError) -> f64| {
        let mut values: Vec<f64> = errors.iter().map(part).collect();
        values.sort_unstable_by(f64::total_cmp);
        values
    };
    let (floor, pixels) = (ascending(|error| error.of_whole), ascending(|error| error.pixels));
    Some(PointsFloor {
        points: errors.len(),
        mean: floor.iter().sum::<f64>() / floor.len() as f64,
        median: quantile(&floor, 0.5),
        quantile_90: quantile(&floor, 0.9),
        feature_px: quantile(&pixels, 0.5) / MEDIAN_OF_NORMAL,
    })
}

/// What the halves of one track say.
struct SplitError {
    /// Along the line of sight, for the whole track.
    of_whole: f64,
    /// The distance between the halves along the line of sight, in standard deviations for features off by one pixel.
    pixels: f64,
}

/// Of the sightings of one point in random order; an odd one is left out of the halves.
fn split_error(sightings: &[Sighting]) -> Option<SplitError> {
    if sightings.len() < SHORTEST_TRACK {
        return None;
    }
    let half = sightings.len() / 2;
    let whole = triangulate(sightings)?;
    let (a, b) = (triangulate(&sightings[..half])?, triangulate(&sightings[half..2 * half])?);
    let lines: DVec3 = sightings.iter().map(|s| (whole.point - s.camera.center()).normalize()).sum();
    let line = lines.try_normalize()?;
    let along = |covariance: &DMat3| line.dot(*covariance * line);
    let distance = (a.point - b.point).dot(line).abs();
    let between = along(&a.covariance) + along(&b.covariance);
    Some(SplitError {
        of_whole: distance * (along(&whole.covariance) / between).sqrt(),
        pixels: distance / between.sqrt(),
    })
}
