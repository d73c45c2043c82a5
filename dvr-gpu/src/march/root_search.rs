//! Root search in a bracket, one ray at a time: the same steps as in `dvr_render`'s search over tensors, which is its reference implementation.

#![allow(missing_docs)]

use cubecl::prelude::*;

use super::plan::Root;

/// Two depths with a crossing between them. Names are those of the literature (Chandrupatla 1997): `x1` is the newest.
#[derive(CubeType)]
pub(super) struct RootSearch {
    x1: RuntimeCell<f32>,
    f1: RuntimeCell<f32>,
    x2: RuntimeCell<f32>,
    f2: RuntimeCell<f32>,
    /// Where to look next: the share of the way from `x1` to `x2`.
    t: RuntimeCell<f32>,
}

#[cube]
impl RootSearch {
    /// One of no meaning.
    pub fn new() -> RootSearch {
        RootSearch {
            x1: RuntimeCell::new(0.0f32),
            f1: RuntimeCell::new(0.0f32),
            x2: RuntimeCell::new(0.0f32),
            f2: RuntimeCell::new(0.0f32),
            t: RuntimeCell::new(0.0f32),
        }
    }

    /// Begins between the last sample outside and the first inside, whose logits have these signs: negative, not
    /// negative.
    pub fn begin(&self, outside: f32, outside_logit: f32, inside: f32, inside_logit: f32, #[comptime] root: Root) {
        self.x1.store(inside);
        self.f1.store(inside_logit);
        self.x2.store(outside);
        self.f2.store(outside_logit);
        // The first guess is the chord's: logits are near linear on a bracket.
        self.guess(root);
    }

    /// The first guess, and that after each narrowing but Chandrupatla's.
    fn guess(&self, #[comptime] root: Root) {
        if comptime!(root == Root::Bisection) {
            self.t.store(0.5f32);
        } else {
            self.t.store(self.chord());
        }
    }

    /// Where the chord crosses zero.
    fn chord(&self) -> f32 {
        self.f1.read() / (self.f1.read() - self.f2.read())
    }

    /// The depth to ask at next.
    pub fn next(&self) -> f32 {
        self.x1.read() + self.t.read() * (self.x2.read() - self.x1.read())
    }

    /// Takes in the logit at [`RootSearch::next`].
    pub fn narrow(&self, f: f32, #[comptime] root: Root) {
        if comptime!(root == Root::Chandrupatla) {
            self.chandrupatla(f);
        } else {
            let x = self.next();
            if f < 0.0f32 {
                self.x2.store(x);
                self.f2.store(f);
            } else {
                self.x1.store(x);
                self.f1.store(f);
            }
            self.guess(root);
        }
    }

    /// Inverse quadratic interpolation where it is safe, bisection where it is not.
    fn chandrupatla(&self, f: f32) {
        let x = self.next();
        let same_side = (f >= 0.0f32) == (self.f1.read() >= 0.0f32);
        let x3 = select(same_side, self.x1.read(), self.x2.read());
        let f3 = select(same_side, self.f1.read(), self.f2.read());
        let x2 = select(same_side, self.x2.read(), self.x1.read());
        let f2 = select(same_side, self.f2.read(), self.f1.read());
        self.x1.store(x);
        self.f1.store(f);
        self.x2.store(x2);
        self.f2.store(f2);
        self.t.store(0.5f32);
        // Of equal points or values nothing can be interpolated.
        if x3 != x2 && x != x2 && f3 != f2 && f3 != f && f != f2 {
            let xi = (x - x2) / (x3 - x2);
            let phi = (f - f2) / (f3 - f2);
            let away = 1.0f32 - phi;
            if phi * phi < xi && away * away < 1.0f32 - xi {
                let t = f / (f2 - f) * f3 / (f2 - f3) + (x3 - x) / (x2 - x) * f / (f3 - f) * f2 / (f3 - f2);
                self.t.store(t.clamp(0.0f32, 1.0f32));
            }
        }
    }

    /// The depth of the crossing, as well as it is known.
    pub fn best(&self, #[comptime] root: Root) -> f32 {
        if comptime!(root == Root::Chandrupatla) {
            select(self.f2.read().abs() < self.f1.read().abs(), self.x2.read(), self.x1.read())
        } else {
            self.next()
        }
    }
}
