//! The similarity that most of many pairs of points agree about.

use glam::DVec3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::camera::Similarity;

/// Triples of pairs that are tried: where a third of the pairs is right, all three of a triple are in one of 27.
const TRIES: usize = 2000;

/// Fits to those that agree, after the best triple.
const ROUNDS: usize = 10;

/// What is further off than this many times the median distance of those that agree, disagrees.
const TRIM: f64 = 3.0;

/// ... but nothing does that is nearer than this share of the tolerance.
const LEAST_REACH: f64 = 0.01;

/// A similarity, and which pairs agree about it.
#[derive(Clone, Debug, PartialEq)]
pub struct AgreedSimilarity {
    /// Takes the first point of a pair to the second.
    pub similarity: Similarity,
    /// For each pair whether it agrees.
    pub agrees: Vec<bool>,
    /// The root mean square of the distances of those that agree, in the units of the second points.
    pub rms: f64,
}

impl AgreedSimilarity {
    /// How many pairs agree.
    pub fn count(&self) -> usize {
        self.agrees.iter().filter(|agrees| **agrees).count()
    }
}

impl Similarity {
    /// The similarity that takes most points of `from` to within `tolerance` of the one at the same place in `to`: the
    /// best of many through three pairs (RANSAC: Fischler and Bolles 1981), then fitted to all that agree, which are
    /// trimmed to what is usual among them.
    ///
    /// `None` where no three pairs determine one, or no pair agrees. The same pairs give the same similarity.
    pub fn between_most(from: &[DVec3], to: &[DVec3], tolerance: f64) -> Option<AgreedSimilarity> {
        if from.len() != to.len() || from.len() < 3 {
            return None;
        }
        let distances = |fit: &Self| -> Vec<f64> {
            from.iter().zip(to).map(|(a, b)| (fit.transform_point(*a) - *b).length()).collect()
        };
        // Counts, and among equal counts prefers what is nearer.
        let worth = |fit: &Self| -> f64 {
            distances(fit).iter().map(|distance| (1.0 - (distance / tolerance).powi(2)).max(0.0)).sum()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut best: Option<(f64, Self)> = None;
        for _ in 0..TRIES {
            let triple: [usize; 3] = std::array::from_fn(|_| rng.random_range(0..from.len()));
            let Some(fit) = Self::between(&triple.map(|i| from[i]), &triple.map(|i| to[i])) else { continue };
            let found = worth(&fit);
            if best.is_none_or(|(most, _)| found > most) {
                best = Some((found, fit));
            }
        }
        let (_, mut fit) = best?;
        let mut reach = tolerance;
        for _ in 0..ROUNDS {
            let near = distances(&fit);
            let mut agreeing: Vec<f64> = near.iter().copied().filter(|distance| *distance <= reach).collect();
            agreeing.sort_by(f64::total_cmp);
            reach = (TRIM * agreeing.get(agreeing.len() / 2)?).clamp(LEAST_REACH * tolerance, tolerance);
            let of = |points: &[DVec3]| -> Vec<DVec3> {
                points.iter().zip(&near).filter(|(_, distance)| **distance <= reach).map(|(point, _)| *point).collect()
            };
            let Some(better) = Self::between(&of(from), &of(to)) else { break };
            fit = better;
        }
        let near = distances(&fit);
        let agrees: Vec<bool> = near.iter().map(|distance| *distance <= reach).collect();
        let squares = near.iter().zip(&agrees).filter(|(_, agrees)| **agrees).map(|(distance, _)| distance.powi(2));
        let rms = (squares.clone().sum::<f64>() / squares.count().max(1) as f64).sqrt();
        Some(AgreedSimilarity { similarity: fit, agrees, rms })
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    /// Points of a ball, where a similarity takes them with some noise, and every so many-th elsewhere.
    fn pairs(count: usize, noise: f64, is_wrong: impl Fn(usize) -> bool) -> (Vec<DVec3>, Vec<DVec3>, Similarity) {
        let moved = Similarity {
            scale: 1.7,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 2.9, 0.2, -1.3),
            translation: DVec3::new(0.5, -3.0, 1.2),
        };
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut random = || DVec3::from_array(std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
        let from: Vec<DVec3> = (0..count).map(|_| random()).collect();
        let to = from.iter().enumerate().map(|(i, point)| {
            if is_wrong(i) { 3.0 * random() } else { moved.transform_point(*point) + noise * random() }
        });
        let to = to.collect();
        (from, to, moved)
    }

    #[test]
    fn a_third_of_the_pairs_that_agree_is_enough() {
        let (from, to, moved) = pairs(240, 0.005, |i| i % 3 != 0);
        let found = Similarity::between_most(&from, &to, 0.05).unwrap();
        assert!((75..=85).contains(&found.count()) && found.rms < 0.01, "{} {}", found.count(), found.rms);
        assert!((found.similarity.scale / moved.scale - 1.0).abs() < 0.002, "{:?}", found.similarity);
        assert!(found.similarity.rotation.angle_between(moved.rotation) < 0.003);
        assert!((found.similarity.translation - moved.translation).length() < 0.005);
        assert_eq!(Similarity::between_most(&from, &to, 0.05), Some(found));
    }

    #[test]
    fn nothing_agrees_where_nothing_is_right_and_exact_pairs_are_exact() {
        let (from, to, _) = pairs(120, 0.0, |_| true);
        let found = Similarity::between_most(&from, &to, 0.05);
        assert!(found.as_ref().is_none_or(|found| found.count() < 15), "{found:?}");
        let (from, to, moved) = pairs(30, 0.0, |i| i % 4 == 0);
        let found = Similarity::between_most(&from, &to, 0.05).unwrap();
        assert!(found.count() >= 20 && (found.similarity.scale - moved.scale).abs() < 1e-9, "{found:?}");
        assert!(Similarity::between_most(&from[..2], &to[..2], 0.05).is_none());
        assert!(Similarity::between_most(&[DVec3::ONE; 5], &[DVec3::ONE; 5], 0.05).is_none());
    }
}
