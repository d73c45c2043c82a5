//! How large a cloud of points is, and round numbers that fit its size.

use glam::DVec3;

use super::distance::quantile;

/// Share of the points that may lie outside, on each side of each axis.
const OUTLIERS: f64 = 0.01;

/// The diagonal of the box that holds all points but the outermost 1 % on each side of each axis.
pub(super) fn extent(points: &[DVec3]) -> f64 {
    let sides = (0..3).map(|axis| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        quantile(&values, 1.0 - OUTLIERS) - quantile(&values, OUTLIERS)
    });
    sides.map(|side| side * side).sum::<f64>().sqrt()
}

/// So many numbers of the series 1, 2, 5, 10, ..., the first of them the largest that does not exceed `start`.
///
/// None where `start` is not positive and finite.
pub(super) fn round_numbers(start: f64, count: usize) -> Vec<f64> {
    if !(start > 0.0 && start.is_finite()) {
        return Vec::new();
    }
    // Powers of ten from text, because 10^-1 times 5 is not 0.5 in floating point.
    let exponent = start.log10().floor() as i32;
    let number = |i: i32| {
        let mantissa = [1, 2, 5][i.rem_euclid(3) as usize];
        format!("{mantissa}e{}", exponent + i.div_euclid(3)).parse().unwrap_or(f64::NAN)
    };
    let first = (-1..=3).rev().find(|&i| number(i) <= start * (1.0 + 1e-12)).unwrap_or(0);
    (first..).take(count).map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extent_does_not_follow_a_few_outliers() {
        let mut points: Vec<DVec3> = (0..=1000).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
        assert!((extent(&points) - 980.0).abs() < 1e-9);
        points.extend([1e9 * DVec3::ONE, -1e9 * DVec3::ONE]);
        assert!((extent(&points) - 980.0).abs() < 10.0);
        assert_eq!(extent(&[DVec3::ONE]), 0.0);
    }

    #[test]
    fn round_numbers_begin_at_or_below_the_start() {
        assert_eq!(round_numbers(0.32, 5), [0.2, 0.5, 1.0, 2.0, 5.0]);
        assert_eq!(round_numbers(0.5, 3), [0.5, 1.0, 2.0]);
        assert_eq!(round_numbers(1.0, 3), [1.0, 2.0, 5.0]);
        assert_eq!(round_numbers(9.99, 2), [5.0, 10.0]);
        assert_eq!(round_numbers(0.0023, 2), [0.002, 0.005]);
        assert!(round_numbers(0.0, 2).is_empty() && round_numbers(f64::NAN, 2).is_empty());
    }
}
