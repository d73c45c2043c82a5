//! Root search in a bracket: where on the ray does the logit cross zero?
//!
//! All rays search together, a fixed number of evaluations each, without data-dependent control flow: one evaluation
//! of the field per step for the whole batch, on any device.

use burn::tensor::{Bool, Tensor};
use serde::{Deserialize, Serialize};

/// How a bracketed crossing is located.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RootMethod {
    /// False position, called "secant" in the paper (section 3.2). One end of the bracket may stay where it is for
    /// ever: with strongly unequal logits it stalls.
    Secant,
    /// Halving the bracket: one bit per step, whatever the function.
    Bisection,
    /// Chandrupatla's method (1997; Scherer, Computational Physics, section 6.1.7.3): inverse quadratic interpolation
    /// where it is safe, bisection where it is not. It keeps a bracket and cannot stall.
    #[default]
    Chandrupatla,
}

/// Brackets of a crossing from outside to inside, one per ray.
#[derive(Clone, Debug)]
pub struct Bracket {
    /// Depth of the last sample outside, `[n]`.
    pub outside: Tensor<1>,
    /// Depth of the first sample inside, `[n]`.
    pub inside: Tensor<1>,
    /// Logit at `outside`, `[n]`, negative.
    pub outside_logit: Tensor<1>,
    /// Logit at `inside`, `[n]`, not negative.
    pub inside_logit: Tensor<1>,
}

impl RootMethod {
    /// Depths of the crossings, `[n]`, after `steps` evaluations of `logit` (depths `[n]` to logits `[n]`) per ray.
    pub fn find(self, bracket: Bracket, steps: usize, logit: impl Fn(Tensor<1>) -> Tensor<1>) -> Tensor<1> {
        match self {
            Self::Secant => shrink(bracket, steps, logit, false_position),
            Self::Bisection => shrink(bracket, steps, logit, |b| (b.outside.clone() + b.inside.clone()) * 0.5),
            Self::Chandrupatla => chandrupatla(bracket, steps, logit),
        }
    }
}

/// Where the chord through the ends of the bracket crosses zero.
fn false_position(bracket: &Bracket) -> Tensor<1> {
    let width = bracket.inside.clone() - bracket.outside.clone();
    let rise = bracket.inside_logit.clone() - bracket.outside_logit.clone();
    bracket.outside.clone() - bracket.outside_logit.clone() * width / rise
}

/// Replaces the end of the bracket that has the sign of the guess, `steps` times; returns the last guess.
fn shrink(
    mut bracket: Bracket,
    steps: usize,
    logit: impl Fn(Tensor<1>) -> Tensor<1>,
    guess: impl Fn(&Bracket) -> Tensor<1>,
) -> Tensor<1> {
    for _ in 0..steps {
        let depth = guess(&bracket);
        let value = logit(depth.clone());
        let outside = value.clone().lower_elem(0.0);
        let inside = outside.clone().bool_not();
        bracket = Bracket {
            outside: bracket.outside.mask_where(outside.clone(), depth.clone()),
            outside_logit: bracket.outside_logit.mask_where(outside, value.clone()),
            inside: bracket.inside.mask_where(inside.clone(), depth),
            inside_logit: bracket.inside_logit.mask_where(inside, value),
        };
    }
    guess(&bracket)
}

/// Chandrupatla's method; names `x1 .. x3`, `xi`, `phi` are those of the literature: `x1` is the newest point, `x1` and
/// `x2` bracket the root, `x3` is the point before.
fn chandrupatla(bracket: Bracket, steps: usize, logit: impl Fn(Tensor<1>) -> Tensor<1>) -> Tensor<1> {
    // The first guess is the chord's rather than the middle: logits are near linear on a bracket.
    let mut t = bracket.inside_logit.clone() / (bracket.inside_logit.clone() - bracket.outside_logit.clone());
    let (mut x1, mut f1) = (bracket.inside, bracket.inside_logit);
    let (mut x2, mut f2) = (bracket.outside, bracket.outside_logit);
    for _ in 0..steps {
        let x = x1.clone() + t.clone() * (x2.clone() - x1.clone());
        let f = logit(x.clone());
        let same_side = is_inside(&f).equal(is_inside(&f1));
        let x3 = x2.clone().mask_where(same_side.clone(), x1.clone());
        let f3 = f2.clone().mask_where(same_side.clone(), f1.clone());
        x2 = x1.mask_where(same_side.clone(), x2);
        f2 = f1.mask_where(same_side, f2);
        (x1, f1) = (x, f);

        let xi = (x1.clone() - x2.clone()) / (x3.clone() - x2.clone());
        let phi = (f1.clone() - f2.clone()) / (f3.clone() - f2.clone());
        // Comparisons with NaN (three equal points or values) are false: those rays bisect.
        let one_minus = |v: Tensor<1>| v.neg() + 1.0;
        let safe = phi.clone().square().lower(xi.clone()).bool_and(one_minus(phi).square().lower(one_minus(xi)));
        let interpolated = f1.clone() / (f2.clone() - f1.clone()) * f3.clone() / (f2.clone() - f3.clone())
            + (x3 - x1.clone()) / (x2.clone() - x1.clone()) * f1.clone() / (f3.clone() - f1.clone()) * f2.clone()
                / (f3 - f2.clone());
        t = interpolated.full_like(0.5).mask_where(safe, interpolated.clamp(0.0, 1.0));
    }
    let second_is_better = f2.abs().lower(f1.abs());
    x1.mask_where(second_is_better, x2)
}

/// Whether a logit is on or inside the surface.
fn is_inside(logit: &Tensor<1>) -> Tensor<1, Bool> {
    logit.clone().greater_equal_elem(0.0)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use burn::tensor::Device;
    use dvr_test_support::max_difference;

    use super::*;

    /// Logits along six rays: straight, bent both ways, with a flat root, steep at one end, with a jump.
    fn logits(d: &[f64]) -> Vec<f64> {
        let of_ray: [fn(f64) -> f64; 6] = [
            |d| 2.0 * d - 0.7,
            |d| d * d * d - 0.2,
            |d| 0.9 - (-3.0 * d).exp() * 1.5,
            |d| (d - 0.55).powi(3),
            |d| (20.0 * (d - 0.8)).exp() - 0.3,
            |d| if d < 0.3 { -0.1 } else { 2.0 + d },
        ];
        of_ray.iter().zip(d).map(|(logit, &d)| logit(d)).collect()
    }

    /// Ends of the brackets: outside, inside.
    const ENDS: [[f64; 6]; 2] = [[0.0, 0.1, 0.0, 0.2, 0.0, 0.0], [1.0, 0.9, 1.0, 1.0, 1.0, 0.75]];

    fn tensor(values: &[f64]) -> Tensor<1> {
        Tensor::from_data(values, &Device::flex())
    }

    fn numbers(values: Tensor<1>) -> Vec<f64> {
        values.into_data().iter::<f64>().collect()
    }

    /// What a method finds, and how often it asked.
    fn found(method: RootMethod, steps: usize) -> (Vec<f64>, usize) {
        let [outside, inside] = ENDS;
        let bracket = Bracket {
            outside: tensor(&outside),
            inside: tensor(&inside),
            outside_logit: tensor(&logits(&outside)),
            inside_logit: tensor(&logits(&inside)),
        };
        let asked = Cell::new(0);
        let depths = method.find(bracket, steps, |depth| {
            asked.set(asked.get() + 1);
            tensor(&logits(&numbers(depth)))
        });
        (numbers(depths), asked.get())
    }

    /// The same for one ray at a time, as the method is written in books.
    fn expected(steps: usize, search: impl Fn(&dyn Fn(f64) -> f64, f64, f64) -> f64) -> Vec<f64> {
        let of_ray = |ray: usize| {
            let logit = move |d: f64| logits(&[d; 6])[ray];
            search(&logit, ENDS[0][ray], ENDS[1][ray])
        };
        assert!(steps < 100);
        (0..6).map(of_ray).collect()
    }

    #[test]
    fn false_position_and_bisection_take_the_steps_of_their_definitions() {
        for steps in [0, 1, 2, 5, 9] {
            let shrinking = |guess: fn(f64, f64, f64, f64) -> f64| {
                expected(steps, |logit, mut outside, mut inside| {
                    for _ in 0..steps {
                        let depth = guess(outside, inside, logit(outside), logit(inside));
                        *(if logit(depth) < 0.0 { &mut outside } else { &mut inside }) = depth;
                    }
                    guess(outside, inside, logit(outside), logit(inside))
                })
            };
            let chord = shrinking(|outside, inside, f0, f1| (outside * f1 - inside * f0) / (f1 - f0));
            let middle = shrinking(|outside, inside, _, _| 0.5 * (outside + inside));
            for (method, expected) in [(RootMethod::Secant, chord), (RootMethod::Bisection, middle)] {
                let (depths, asked) = found(method, steps);
                assert_eq!(asked, steps);
                let off = max_difference(&depths, &expected);
                assert!(off < 2e-6, "{method:?}, {steps} steps: {off}, {depths:?}, {expected:?}");
            }
        }
    }

    /// Scherer's listing of Chandrupatla's method, begun at the chord; each step is decided by signs alone.
    fn chandrupatla_of_one_ray(logit: &dyn Fn(f64) -> f64, outside: f64, inside: f64, steps: usize) -> f64 {
        let is_inside = |f: f64| f >= 0.0;
        let (mut a, mut b) = (inside, outside);
        let (mut fa, mut fb) = (logit(a), logit(b));
        let mut t = fa / (fa - fb);
        for _ in 0..steps {
            let x = a + t * (b - a);
            let fx = logit(x);
            let (c, fc);
            if is_inside(fx) == is_inside(fa) {
                (c, fc) = (a, fa);
            } else {
                (c, fc) = (b, fb);
                (b, fb) = (a, fa);
            }
            (a, fa) = (x, fx);
            let (xi, phi) = ((a - b) / (c - b), (fa - fb) / (fc - fb));
            t = if phi * phi < xi && (1.0 - phi) * (1.0 - phi) < 1.0 - xi {
                let quadratic =
                    fa / (fb - fa) * (fc / (fb - fc)) + (c - a) / (b - a) * (fa / (fc - fa)) * (fb / (fc - fb));
                quadratic.clamp(0.0, 1.0)
            } else {
                0.5
            };
        }
        if fb.abs() < fa.abs() { b } else { a }
    }

    #[test]
    fn chandrupatla_takes_the_steps_of_the_literature() {
        for steps in 0..8 {
            let (depths, asked) = found(RootMethod::Chandrupatla, steps);
            assert_eq!(asked, steps);
            let expected = expected(steps, |logit, a, b| chandrupatla_of_one_ray(logit, a, b, steps));
            let off = max_difference(&depths, &expected);
            assert!(off < 1e-4, "{steps} steps: {off}, {depths:?}, {expected:?}");
        }
    }

    #[test]
    fn chandrupatla_finds_what_is_steep_or_flat_or_jumps_where_false_position_stalls() {
        let roots = [0.35, 0.2f64.cbrt(), (1.5f64 / 0.9).ln() / 3.0, 0.55, 0.8 + 0.3f64.ln() / 20.0, 0.3];
        let (depths, _) = found(RootMethod::Chandrupatla, 20);
        // In single precision the cube of a flat root vanishes near it.
        for ((depth, root), tolerance) in depths.iter().zip(roots).zip([1e-6, 1e-6, 1e-6, 0.01, 1e-6, 1e-4]) {
            assert!((depth - root).abs() < tolerance, "{depth}, not {root}");
        }
        let (stalled, _) = found(RootMethod::Secant, 20);
        assert!((stalled[4] - roots[4]).abs() > 0.05, "{stalled:?}");
    }
}
