//! A list of distances in a few figures.

use serde::{Deserialize, Serialize};

/// Distances from points to the nearest place of a mesh, summed up. All are in the units of the files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DistanceSummary {
    /// The mean.
    pub mean: f64,
    /// Half of the points are at most this far.
    pub median: f64,
    /// 90 % of the points are at most this far.
    pub quantile_90: f64,
    /// 95 % of the points are at most this far.
    pub quantile_95: f64,
    /// 99 % of the points are at most this far.
    pub quantile_99: f64,
    /// The largest.
    pub max: f64,
    /// Shares of the points below thresholds, in the order in which these were asked for.
    pub below: Vec<ShareBelow>,
}

/// A share of points below a distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShareBelow {
    /// The distance.
    pub threshold: f64,
    /// Share of the points that are nearer, of all.
    pub share: f64,
}

impl DistanceSummary {
    /// Sums up; the figures of no distances are 0.
    pub fn new(mut distances: Vec<f64>, thresholds: &[f64]) -> Self {
        distances.sort_unstable_by(f64::total_cmp);
        let count = distances.len().max(1) as f64;
        let below = thresholds.iter().map(|&threshold| ShareBelow {
            threshold,
            share: distances.partition_point(|&distance| distance < threshold) as f64 / count,
        });
        Self {
            // The sum of nothing is -0.
            mean: (0.0 + distances.iter().sum::<f64>()) / count,
            median: quantile(&distances, 0.5),
            quantile_90: quantile(&distances, 0.9),
            quantile_95: quantile(&distances, 0.95),
            quantile_99: quantile(&distances, 0.99),
            max: distances.last().copied().unwrap_or(0.0),
            below: below.collect(),
        }
    }
}

/// A quantile of ascending values, interpolated linearly between the two next to it, as numpy does; 0 of none.
pub(in crate::metrics) fn quantile(ascending: &[f64], share: f64) -> f64 {
    let Some(last) = ascending.len().checked_sub(1) else { return 0.0 };
    let place = share * last as f64;
    let low = place.floor() as usize;
    let (a, b) = (ascending[low], ascending[(low + 1).min(last)]);
    a + (place - low as f64) * (b - a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_numpy_and_shares_count_what_is_below() {
        // numpy.quantile([0, 1, ..., 10], q); the order does not matter.
        let distances = [7.0, 0.0, 10.0, 3.0, 1.0, 9.0, 2.0, 8.0, 4.0, 6.0, 5.0];
        let summary = DistanceSummary::new(distances.to_vec(), &[2.0, 2.5, 100.0]);
        assert_eq!((summary.mean, summary.median, summary.max), (5.0, 5.0, 10.0));
        assert!((summary.quantile_90 - 9.0).abs() < 1e-12 && (summary.quantile_95 - 9.5).abs() < 1e-12);
        assert!((summary.quantile_99 - 9.9).abs() < 1e-12);
        let shares: Vec<f64> = summary.below.iter().map(|below| below.share).collect();
        assert_eq!(shares, [2.0 / 11.0, 3.0 / 11.0, 1.0], "a distance of 2 is not below 2");
    }

    #[test]
    fn the_median_of_an_even_number_lies_between_the_middle_two() {
        assert_eq!(DistanceSummary::new(vec![4.0, 1.0, 2.0, 100.0], &[]).median, 3.0);
        assert_eq!(DistanceSummary::new(Vec::new(), &[1.0]).max, 0.0);
    }
}
