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
