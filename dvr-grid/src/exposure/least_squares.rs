//! Gains of views from colours that pairs of them show of the same points: robust least squares.

/// How much brighter the second view of a pair shows a point than the first, as a difference of logarithms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ratio {
    pub views: [u32; 2],
    pub log: f64,
}

/// Rounds of reweighting.
const ROUNDS: usize = 15;

/// Residuals below this, about two levels of eight bits, count as squares, those above by their size.
const KNEE: f64 = 0.02;

/// The weight of `gain = 0`, beside one for each ratio that fits: what hardly any ratio says of a view is not believed.
const PRIOR: f64 = 0.1;

/// A change of the solution that is none.
const SETTLED: f64 = 1e-9;

/// The logarithms of the gains that make views alike, with zero mean over views that are compared with each other; 0
/// for a view that no ratio names. Minimises `sum rho(log + x_second - x_first) + PRIOR/2 sum x^2` with Huber's `rho`, by
/// iteratively reweighted least squares.
pub(super) fn gains(ratios: &[Ratio], views: usize) -> Vec<f64> {
    let mut found = vec![0.0; views];
    for _ in 0..ROUNDS {
        let weight = |ratio: &Ratio| KNEE / residual(ratio, &found).abs().max(KNEE);
        let weighted: Vec<(Ratio, f64)> = ratios.iter().map(|ratio| (*ratio, weight(ratio))).collect();
        let edges = per_pair(&weighted);
        let next = conjugate_gradient(&edges, &found);
        let moved = next.iter().zip(&found).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        found = next;
        if moved < SETTLED {
            break;
        }
    }
    found
}

/// What is left of a ratio.
pub(super) fn residual(ratio: &Ratio, gains: &[f64]) -> f64 {
    let [first, second] = ratio.views.map(|view| gains[view as usize]);
    ratio.log + second - first
}

/// What all ratios of a pair of views say together.
struct Edge {
    views: [usize; 2],
    weight: f64,
    /// Sum of the weighted logarithms.
    log: f64,
}

/// Sums in a fixed order.
fn per_pair(weighted: &[(Ratio, f64)]) -> Vec<Edge> {
    let mut sums = std::collections::BTreeMap::<[u32; 2], (f64, f64)>::new();
    for (ratio, weight) in weighted {
        let sum = sums.entry(ratio.views).or_default();
        *sum = (sum.0 + weight, sum.1 + weight * ratio.log);
    }
    let edge = |(views, (weight, log)): ([u32; 2], (f64, f64))| Edge { views: views.map(|v| v as usize), weight, log };
    sums.into_iter().map(edge).collect()
}

/// Solves the normal equations, starting from `start`.
fn conjugate_gradient(edges: &[Edge], start: &[f64]) -> Vec<f64> {
    let times = |x: &[f64]| {
        let mut y: Vec<f64> = x.iter().map(|x| PRIOR * x).collect();
        for Edge { views: [a, b], weight, .. } in edges {
            let pull = weight * (x[*a] - x[*b]);
            y[*a] += pull;
            y[*b] -= pull;
        }
        y
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut wanted = vec![0.0; start.len()];
    for Edge { views: [a, b], log, .. } in edges {
        wanted[*a] += log;
        wanted[*b] -= log;
    }
    let mut x = start.to_vec();
    let mut rest: Vec<f64> = wanted.iter().zip(times(&x)).map(|(wanted, have)| wanted - have).collect();
    let mut direction = rest.clone();
    let mut size = dot(&rest, &rest);
    let enough = 1e-20 * dot(&wanted, &wanted);
    for _ in 0..2 * start.len() {
        if size <= enough {
            break;
        }
        let image = times(&direction);
        let step = size / dot(&direction, &image);
        for i in 0..x.len() {
            x[i] += step * direction[i];
            rest[i] -= step * image[i];
        }
        let next = dot(&rest, &rest);
        for i in 0..x.len() {
            direction[i] = rest[i] + next / size * direction[i];
        }
        size = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel_order::mix;

    /// Between -1 and 1.
    fn noise(seed: u64) -> f64 {
        mix(seed) as f64 / u64::MAX as f64 * 2.0 - 1.0
    }

    /// What neighbours on a ring of views say, when each is this much brighter than the mean.
    fn ring(brightness: &[f64], each: usize, outliers: f64) -> Vec<Ratio> {
        let views = brightness.len();
        let ratio = |i: usize| {
            let (first, second) = (i % views, (i + 1 + i / views % 2) % views);
            let is_outlier = noise(7 * i as u64) * 0.5 + 0.5 < outliers;
            let log = brightness[second] - brightness[first] + if is_outlier { 0.5 } else { 0.01 * noise(i as u64) };
            Ratio { views: [first as u32, second as u32], log }
        };
        (0..each * views).map(ratio).collect()
    }

    #[test]
    fn gains_undo_brightness_also_among_outliers_and_have_zero_mean() {
        let brightness: Vec<f64> = (0..40).map(|view| 0.3 * noise(1000 + view)).collect();
        let mean = brightness.iter().sum::<f64>() / 40.0;
        for (outliers, tolerance) in [(0.0, 0.01), (0.1, 0.03)] {
            let found = gains(&ring(&brightness, 300, outliers), 40);
            for (gain, brightness) in found.iter().zip(&brightness) {
                assert!((gain + brightness - mean).abs() < tolerance, "{gain} {brightness} {outliers}");
            }
            assert!(found.iter().sum::<f64>().abs() < 1e-6);
        }
    }

    #[test]
    fn a_view_that_nothing_is_said_of_keeps_its_exposure_and_parts_that_do_not_meet_have_their_own_mean() {
        let two = [Ratio { views: [0, 1], log: 0.4 }; 300];
        let apart = [Ratio { views: [3, 4], log: -0.2 }; 300];
        let found = gains(&[two, apart].concat(), 5);
        let expected = [0.2, -0.2, 0.0, -0.1, 0.1];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 2e-3), "{found:?}");
        assert_eq!(gains(&[], 2), [0.0, 0.0]);
    }
}
