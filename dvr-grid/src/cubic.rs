//! The first upward zero crossing of a cubic on an interval.

/// Coefficients `c0 + c1 t + c2 t^2 + c3 t^3`.
pub type Cubic = [f32; 4];

/// Halvings and Newton steps that refine a bracketed root; f32 is exhausted after about a dozen.
const MAX_ITERATIONS: usize = 24;

/// The value at `t`.
pub fn evaluate(c: &Cubic, t: f32) -> f32 {
    ((c[3] * t + c[2]) * t + c[1]) * t + c[0]
}

fn slope(c: &Cubic, t: f32) -> f32 {
    (3.0 * c[3] * t + 2.0 * c[2]) * t + c[1]
}

/// The smallest `t` in `[0, 1]` at which a cubic that starts negative reaches zero; `None` where it stays negative.
/// A cubic that does not start negative is at its crossing at once, `Some(0.0)`.
pub fn first_crossing(c: &Cubic) -> Option<f32> {
    if c[0] >= 0.0 {
        return Some(0.0);
    }
    // Bernstein coefficients: where all are negative the cubic is (convex hull property).
    let bernstein = [c[0], c[0] + c[1] / 3.0, c[0] + (2.0 * c[1] + c[2]) / 3.0, c[0] + c[1] + c[2] + c[3]];
    if bernstein.iter().all(|&b| b < 0.0) {
        return None;
    }
    // Between its extrema the cubic is monotone: the first piece whose end is not negative holds the crossing.
    let mut start = 0.0;
    for end in pieces(c) {
        if evaluate(c, end) >= 0.0 {
            return Some(bracketed(c, start, end));
        }
        start = end;
    }
    None
}

/// Ends of the monotone pieces of `[0, 1]`, rising, the last one 1.
fn pieces(c: &Cubic) -> impl Iterator<Item = f32> {
    // Roots of 3 c3 t^2 + 2 c2 t + c1 by the form that does not cancel.
    let discriminant = c[2] * c[2] - 3.0 * c[3] * c[1];
    let (first, second) = if discriminant > 0.0 {
        let q = -(c[2] + discriminant.sqrt().copysign(c[2]));
        (q / (3.0 * c[3]), c[1] / q)
    } else {
        (f32::NAN, f32::NAN)
    };
    // NaN and infinities fail the comparison below.
    let (low, high) = if first > second { (second, first) } else { (first, second) };
    [low, high].into_iter().filter(|t| *t > 0.0 && *t < 1.0).chain([1.0])
}

/// The root between `low`, where the cubic is negative, and `high`, where it is not: Newton kept in its bracket.
fn bracketed(c: &Cubic, mut low: f32, mut high: f32) -> f32 {
    let mut t = {
        let (a, b) = (evaluate(c, low), evaluate(c, high));
        low + (high - low) * (a / (a - b)).clamp(0.0, 1.0)
    };
    for _ in 0..MAX_ITERATIONS {
        let value = evaluate(c, t);
        if value == 0.0 {
            return t;
        }
        if value < 0.0 {
            low = t;
        } else {
            high = t;
        }
        let newton = t - value / slope(c, t);
        if (newton - t).abs() <= 1e-7 {
            return newton.clamp(low, high);
        }
        t = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
    }
    t
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// The slow reference: the first of many samples that is not negative.
    fn sampled(c: &Cubic, samples: usize) -> Option<f32> {
        (0..=samples).map(|i| i as f32 / samples as f32).find(|&t| evaluate(c, t) >= 0.0)
    }

    #[test]
    fn agrees_with_dense_sampling() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        // How far below zero a cubic starts at most, and how steep it is.
        for (depth, steepness) in [(0.2, 2.0), (2.0, 2.0), (1.0, 30.0)] {
            let tolerance = 1e-5 * steepness;
            for _ in 0..5_000 {
                let mut coefficient = || (2.0 * rng.random::<f32>() - 1.0) * steepness;
                let [b, c, d] = [coefficient(), coefficient(), coefficient()];
                let c: Cubic = [-rng.random::<f32>() * depth, b, c, d];
                match (first_crossing(&c), sampled(&c, 1000)) {
                    (Some(found), Some(expected)) => {
                        assert!(found <= expected + 1e-5, "{c:?}: {found} after {expected}");
                        assert!(evaluate(&c, found).abs() < tolerance, "{c:?}: {}", evaluate(&c, found));
                    }
                    (None, Some(expected)) => panic!("{c:?}: missed {expected}"),
                    // Between two samples the cubic may touch zero and fall again.
                    (Some(found), None) => assert!(evaluate(&c, found).abs() < tolerance, "{c:?}"),
                    (None, None) => {}
                }
            }
        }
    }

    #[test]
    fn one_bernstein_coefficient_above_zero_is_enough_for_a_crossing() {
        // Each rises above zero and falls below it again, and all but one coefficient are below zero.
        for (c, at) in
            [([-0.5, 9.0, -40.0, 30.0], 0.087), ([-1.0, 2.9, -2.0, -0.1], 0.604), ([-0.5, 0.0, 31.5, -31.5], 0.135)]
        {
            let found = first_crossing(&c).unwrap_or_else(|| panic!("{c:?} has a crossing"));
            assert!((found - at).abs() < 2e-3 && evaluate(&c, found).abs() < 1e-5, "{c:?}: {found}");
        }
    }

    #[test]
    fn degenerate_cubics_are_handled() {
        assert_eq!(first_crossing(&[0.0, 0.0, 0.0, 0.0]), Some(0.0));
        assert_eq!(first_crossing(&[-1.0, 0.0, 0.0, 0.0]), None);
        assert!((first_crossing(&[-1.0, 2.0, 0.0, 0.0]).unwrap() - 0.5).abs() < 1e-6);
        assert!((first_crossing(&[-1.0, 0.0, 4.0, 0.0]).unwrap() - 0.5).abs() < 1e-6);
        assert!((first_crossing(&[-1.0, 1.0, 0.0, 0.0]).unwrap() - 1.0).abs() < 1e-6);
    }
}
