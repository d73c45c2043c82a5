//! How far two surfaces are apart, measured between points sampled from them.
//!
//! Lengths are in units of the object cube `[-0.5, 0.5]^3`. (Papers print Chamfer-L1 times ten.) Distances between two
//! *samples* are not zero for equal surfaces: [`surface_floor`] and [`cloud_floor`] say what a perfect reconstruction
//! would score, and a score should be read beside its floor.

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::error::{ComparisonError, Result};
use crate::mesh::Mesh;
use crate::points::PointCloud;
use crate::sampling::sample_surface;

/// Surface points that scores are computed from, as in the paper.
pub const SURFACE_SAMPLES: usize = 100_000;

/// Distances at which the F-score is usually asked for.
pub const F_SCORE_THRESHOLDS: [f64; 3] = [0.005, 0.01, 0.02];

/// The distance that counts where one of the surfaces has no points: the cube's diagonal, `sqrt(3)`.
pub const EMPTY_DISTANCE: f64 = 1.732_050_807_568_877_2;

/// How far a predicted surface is from the true one.
///
/// Where one of the two has no points, every distance is [`EMPTY_DISTANCE`] and every other figure 0; where neither
/// has, the two agree: distances are 0 and everything else is 1.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ShapeScore {
    /// Mean distance from a predicted point to the nearest true one.
    pub accuracy: f64,
    /// Mean distance from a true point to the nearest predicted one.
    pub completeness: f64,
    /// `(accuracy + completeness) / 2`. Papers print ten times this.
    pub chamfer_l1: f64,
    /// Mean squared distance from a predicted point to the nearest true one.
    pub accuracy_squared: f64,
    /// Mean squared distance from a true point to the nearest predicted one.
    pub completeness_squared: f64,
    /// `(accuracy_squared + completeness_squared) / 2`, `chamfer` of DVR's reference code.
    pub chamfer_l2: f64,
    /// Mean `|n . n'|` between a point's normal and that of its nearest neighbour on the other surface, averaged over
    /// both directions; `None` where points come without normals.
    pub normal_consistency: Option<NormalConsistency>,
    /// Precision, recall and F-score at each threshold that was asked for, in that order.
    pub f_scores: Vec<FScore>,
}

/// The two directions of the normal consistency, and their mean.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct NormalConsistency {
    /// From predicted points to true ones.
    pub accuracy: f64,
    /// From true points to predicted ones.
    pub completeness: f64,
    /// The mean of the two.
    pub mean: f64,
}

/// Shares of points within a distance of the other surface (Knapitsch et al. 2017).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FScore {
    /// The distance.
    pub threshold: f64,
    /// Share of the predicted points that have a true one at most this far away.
    pub precision: f64,
    /// Share of the true points that have a predicted one at most this far away.
    pub recall: f64,
    /// The harmonic mean of the two; 0 where both are 0.
    pub f_score: f64,
}

/// Scores a predicted surface against the true one, both given by points (the field takes [`SURFACE_SAMPLES`] of each)
/// and, for the normal consistency, unit normals.
///
/// # Errors
/// When a cloud has another number of normals than of points, or a point that is not finite.
pub fn score_surface(predicted: &PointCloud, truth: &PointCloud, thresholds: &[f64]) -> Result<ShapeScore> {
    let (predicted, truth) = (Surface::new("predicted", predicted)?, Surface::new("true", truth)?);
    Ok(score(&predicted.toward(&truth), &truth.toward(&predicted), thresholds))
}

/// Scores parts of a predicted and of a true surface, each against the whole of the other. Each surface is given as the
/// whole and then the part; clouds as in [`score_surface`].
///
/// # Errors
/// As [`score_surface`].
pub(super) fn score_parts(
    predicted: [&PointCloud; 2],
    truth: [&PointCloud; 2],
    thresholds: &[f64],
) -> Result<ShapeScore> {
    let predicted = (Surface::new("predicted", predicted[0])?, Surface::new("predicted", predicted[1])?);
    let truth = (Surface::new("true", truth[0])?, Surface::new("true", truth[1])?);
    Ok(score(&predicted.1.toward(&truth.0), &truth.1.toward(&predicted.0), thresholds))
}

/// What the true surface scores when it is sampled twice, independently, with `count` points.
///
/// # Errors
/// When the mesh has no area.
pub fn surface_floor(truth: &Mesh, count: usize, thresholds: &[f64], seed: u64) -> Result<ShapeScore> {
    let sample = |seed| PointCloud::from(sample_surface(truth, count, seed));
    let (a, b) = (sample(seed), sample(seed.wrapping_add(1)));
    if a.points.is_empty() {
        return Err(ComparisonError::NoArea.into());
    }
    score_surface(&a, &b, thresholds)
}

/// What the true surface would score when it is only known by a cloud and the prediction is sampled with `predicted`
/// points.
///
/// The cloud is split at random into disjoint halves, and these are scored against each other. On a surface the
/// distance to the nearest of `n` independent points shrinks as `1/sqrt(n)`, so the distances are multiplied by
/// `sqrt(half / cloud)` (accuracy) and `sqrt(half / predicted)` (completeness), as if both were whole. Normals
/// cannot be corrected so; their floor is that of the halves, and slightly low.
///
/// # Errors
/// When the cloud has fewer than two points, or see [`score_surface`].
pub fn cloud_floor(truth: &PointCloud, predicted: usize, thresholds: &[f64], seed: u64) -> Result<ShapeScore> {
    let count = truth.points.len();
    if count < 2 || predicted == 0 {
        return Err(ComparisonError::NoFloor { points: count, predicted }.into());
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let half = count / 2;
    let part = |indices: &[usize]| PointCloud {
        points: indices.iter().map(|&i| truth.points[i]).collect(),
        normals: truth
            .normals
            .as_ref()
            .map(|normals| indices.iter().filter_map(|&i| normals.get(i).copied()).collect()),
        colors: None,
    };
    let (a, b) = (part(&order[..half]), part(&order[half..2 * half]));
    let (a, b) = (Surface::new("true", &a)?, Surface::new("true", &b)?);
    let shrink = |whole: usize| (half as f64 / whole as f64).sqrt();
    Ok(score(&a.toward(&b).scaled(shrink(count)), &b.toward(&a).scaled(shrink(predicted)), thresholds))
}

/// A cloud with its search tree.
struct Surface<'a> {
    cloud: &'a PointCloud,
    /// `None` for an empty cloud.
    tree: Option<ImmutableKdTree<f64, 3>>,
}

/// From the points of one surface to their nearest neighbours on another.
struct Distances {
    distances: Vec<f64>,
    /// `|n . n'|`, where both surfaces have normals.
    normal_agreement: Option<Vec<f64>>,
    /// Whether the surface started from, and the one that was looked for, have no points.
    empty: [bool; 2],
}

impl<'a> Surface<'a> {
    fn new(which: &'static str, cloud: &'a PointCloud) -> Result<Self> {
        let problem = if cloud.normals.as_ref().is_some_and(|normals| normals.len() != cloud.points.len()) {
            "has another number of normals than of points"
        } else if !cloud.points.iter().all(|point| point.is_finite()) {
            "has points that are not finite"
        } else if cloud.points.len() > u32::MAX as usize {
            "has more than 2^32 points"
        } else {
            let points: Vec<[f64; 3]> = cloud.points.iter().map(|point| point.as_dvec3().to_array()).collect();
            let tree = if points.is_empty() { None } else { ImmutableKdTree::new_from_slice(&points).ok() };
            return Ok(Self { cloud, tree });
        };
        Err(ComparisonError::Surface { which, problem }.into())
    }

    fn toward(&self, other: &Self) -> Distances {
        let normals = self.cloud.normals.as_ref().zip(other.cloud.normals.as_ref());
        let nearest: Vec<(f64, usize)> = match &other.tree {
            None => Vec::new(),
            Some(tree) => (self.cloud.points.par_iter())
                .map(|point| {
                    let query = point.as_dvec3().to_array();
                    let found = tree.query(&query).nearest_one::<SquaredEuclidean<f64>>().execute();
                    (found.distance.sqrt(), found.item as usize)
                })
                .collect(),
        };
        let agreement = |(own, others): (&Vec<Vec3>, &Vec<Vec3>)| {
            let dot = |(n, &(_, item)): (&Vec3, &(f64, usize))| {
                f64::from(n.normalize_or_zero().dot(others[item].normalize_or_zero()).abs())
            };
            own.iter().zip(&nearest).map(dot).collect()
        };
        Distances {
            normal_agreement: normals.map(agreement),
            distances: nearest.into_iter().map(|(distance, _)| distance).collect(),
            empty: [self.cloud.points.is_empty(), other.cloud.points.is_empty()],
        }
    }
}

impl Distances {
    fn scaled(mut self, factor: f64) -> Self {
        self.distances.iter_mut().for_each(|distance| *distance *= factor);
        self
    }

    /// The mean over the points, or what stands for it where there are none.
    fn mean(&self, values: impl Iterator<Item = f64>, one_empty: f64, both_empty: f64) -> f64 {
        match self.empty {
            [false, false] => values.sum::<f64>() / self.distances.len() as f64,
            [true, true] => both_empty,
            _ => one_empty,
        }
    }

    fn mean_distance(&self) -> f64 {
        self.mean(self.distances.iter().copied(), EMPTY_DISTANCE, 0.0)
    }

    fn mean_squared_distance(&self) -> f64 {
        self.mean(self.distances.iter().map(|d| d * d), EMPTY_DISTANCE * EMPTY_DISTANCE, 0.0)
    }

    fn share_within(&self, threshold: f64) -> f64 {
        self.mean(self.distances.iter().map(|&d| f64::from(u8::from(d <= threshold))), 0.0, 1.0)
    }

    fn mean_agreement(&self) -> Option<f64> {
        self.normal_agreement.as_ref().map(|agreement| self.mean(agreement.iter().copied(), 0.0, 1.0))
    }
}

fn score(to_truth: &Distances, to_predicted: &Distances, thresholds: &[f64]) -> ShapeScore {
    let half_sum = |a: f64, b: f64| 0.5 * (a + b);
    let (accuracy, completeness) = (to_truth.mean_distance(), to_predicted.mean_distance());
    let (accuracy_squared, completeness_squared) =
        (to_truth.mean_squared_distance(), to_predicted.mean_squared_distance());
    let normals = to_truth.mean_agreement().zip(to_predicted.mean_agreement());
    let f_scores = thresholds.iter().map(|&threshold| {
        let (precision, recall) = (to_truth.share_within(threshold), to_predicted.share_within(threshold));
        let sum = precision + recall;
        let f_score = if sum > 0.0 { 2.0 * precision * recall / sum } else { 0.0 };
        FScore { threshold, precision, recall, f_score }
    });
    ShapeScore {
        accuracy,
        completeness,
        chamfer_l1: half_sum(accuracy, completeness),
        accuracy_squared,
        completeness_squared,
        chamfer_l2: half_sum(accuracy_squared, completeness_squared),
        normal_consistency: normals.map(|(accuracy, completeness)| NormalConsistency {
            accuracy,
            completeness,
            mean: half_sum(accuracy, completeness),
        }),
        f_scores: f_scores.collect(),
    }
}

#[cfg(test)]
#[path = "shape_tests.rs"]
mod tests;
