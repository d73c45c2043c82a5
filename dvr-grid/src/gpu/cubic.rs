//! The first upward zero crossing of a cubic, inside a kernel: the counterpart of `crate::cubic`.

#![allow(missing_docs)]

use cubecl::prelude::*;

/// Newton steps and halvings that refine a root.
const MAX_ITERATIONS: u32 = 24;

/// Nowhere: no crossing lies there.
pub(crate) const NOWHERE: f32 = -1.0;

/// `c0 + c1 t + c2 t^2 + c3 t^3`.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Cubic {
    pub c0: f32,
    pub c1: f32,
    pub c2: f32,
    pub c3: f32,
}

#[cube]
impl Cubic {
    fn value(&self, t: f32) -> f32 {
        ((self.c3 * t + self.c2) * t + self.c1) * t + self.c0
    }

    fn slope(&self, t: f32) -> f32 {
        (3.0f32 * self.c3 * t + 2.0f32 * self.c2) * t + self.c1
    }

    /// The smallest `t` in `[0, 1]` at which a cubic that starts negative reaches zero, [`NOWHERE`] where it stays
    /// negative; 0 where it does not start negative.
    pub fn first_crossing(&self) -> f32 {
        let mut crossing = f32::new(NOWHERE);
        if self.c0 >= 0.0f32 {
            crossing = 0.0f32;
        } else {
            // Bernstein coefficients: where all are negative the cubic is.
            let second = self.c0 + self.c1 / 3.0f32;
            let third = self.c0 + (2.0f32 * self.c1 + self.c2) / 3.0f32;
            let last = self.c0 + self.c1 + self.c2 + self.c3;
            if second >= 0.0f32 || third >= 0.0f32 || last >= 0.0f32 {
                crossing = self.crossing_of_pieces();
            }
        }
        crossing
    }

    /// Between its extrema the cubic is monotone: the first piece whose end is not negative holds the crossing.
    fn crossing_of_pieces(&self) -> f32 {
        let mut first = 2.0f32;
        let mut second = 2.0f32;
        let discriminant = self.c2 * self.c2 - 3.0f32 * self.c3 * self.c1;
        if discriminant > 0.0f32 {
            let root = discriminant.sqrt();
            let q = -(self.c2 + select(self.c2 < 0.0f32, -root, root));
            if self.c3 != 0.0f32 {
                first = q / (3.0f32 * self.c3);
            }
            if q != 0.0f32 {
                second = self.c1 / q;
            }
        }
        let early = first.min(second);
        let late = first.max(second);
        let mut low = 0.0f32;
        let mut high = 1.0f32;
        let early_counts = early > 0.0f32 && early < 1.0f32;
        let late_counts = late > 0.0f32 && late < 1.0f32;
        if early_counts && self.value(early) >= 0.0f32 {
            high = early;
        } else {
            low = select(early_counts, early, 0.0f32);
            if late_counts {
                if self.value(late) >= 0.0f32 {
                    high = late;
                } else {
                    low = late;
                }
            }
        }
        let mut crossing = f32::new(NOWHERE);
        if self.value(high) >= 0.0f32 {
            crossing = self.bracketed(low, high);
        }
        crossing
    }

    /// The root between `from`, where the cubic is negative, and `to`, where it is not: Newton kept in its bracket.
    fn bracketed(&self, from: f32, to: f32) -> f32 {
        let mut low = from;
        let mut high = to;
        let at_low = self.value(low);
        let at_high = self.value(high);
        let mut t = low + (high - low) * (at_low / (at_low - at_high)).clamp(0.0f32, 1.0f32);
        let mut left = u32::new(MAX_ITERATIONS as i64);
        while left > 0u32 {
            left -= 1u32;
            let value = self.value(t);
            if value == 0.0f32 {
                left = 0u32;
            } else {
                if value < 0.0f32 {
                    low = t;
                } else {
                    high = t;
                }
                let newton = t - value / self.slope(t);
                if (newton - t).abs() <= 1e-7f32 {
                    t = newton.max(low).min(high);
                    left = 0u32;
                } else {
                    t = select(newton > low && newton < high, newton, 0.5f32 * (low + high));
                }
            }
        }
        t
    }
}
