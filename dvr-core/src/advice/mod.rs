//! What to photograph again, before it costs time: pictures that are blurred, burnt or black, sides that nothing shows,
//! pictures that share too little with others, zoom or focus that changed.
//!
//! One file per question; each looks at the pictures and cameras alone, and says nothing where it cannot tell. A rolling
//! shutter is not asked for: cameras that were found with one are consistent with it, and a picture does not tell.

mod acuity;
mod blur;
mod clipping;
mod directions;
mod finding;
mod focal_length;
mod gaps;
mod orbit;
mod overlap;

pub use finding::{Advice, Topic, ViewFigure};
pub use orbit::{Orbit, Side};

use crate::cancellation::{Cancellation, Cancelled};
use crate::scene::Scene;

impl Scene {
    /// What to photograph again, and why; nothing where nothing is known to be wrong. Masks are looked at as training
    /// takes them. It takes a few milliseconds per million pixels.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn advice(&self, cancellation: &Cancellation) -> Result<Vec<Advice>, Cancelled> {
        let orbit = Orbit::of(self);
        let mut found: Vec<Advice> = blur::advice(self, &orbit, cancellation)?.into_iter().collect();
        found.extend(clipping::advice(self, &orbit, cancellation)?);
        found.extend(gaps::advice(self, &orbit));
        found.extend(overlap::advice(self, &orbit));
        found.extend(focal_length::advice(self));
        Ok(found)
    }
}

#[cfg(test)]
mod tests;
