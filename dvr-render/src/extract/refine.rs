//! Moves each vertex along its grid edge to where the field really crosses the level.
//!
//! Linear interpolation between two nodes is exact for a field that is linear in between; a trained occupancy logit is
//! steep and bent. The root search stays in its bracket, hence the vertex on its edge and the topology as it was.

use glam::Vec3;

use super::error::Result;
use super::grid::GridGeometry;
use super::sampler::Sampler;
use super::surface::{Crossing, keep_off_nodes};
use crate::field::scalar::ScalarField;

/// A vertex is done when a further evaluation moves it by less than this, in units of the edge. As the evaluations are
/// not where the vertex is expected, the field is then known to be straight enough there.
const TOLERANCE: f64 = 1e-3;

/// A crossing still being searched, by the ITP method (Oliveira and Takahashi 2020): nearly as fast as the secant where
/// the field is tame, and never slower than bisection plus one step where it is not (the secant alone may crawl).
struct EdgeBracket {
    crossing: usize,
    /// Ends of the bracket, in units of the edge.
    t: [f64; 2],
    /// Values at the ends, of different signs.
    values: [f64; 2],
}

impl EdgeBracket {
    /// The root of the straight line through the ends.
    fn secant(&self) -> f64 {
        let [a, b] = self.values;
        self.t[0] + (self.t[1] - self.t[0]) * (a / (a - b))
    }

    /// Where to look in step `step`, counted from 0.
    fn next(&self, step: usize) -> f64 {
        let width = self.t[1] - self.t[0];
        let middle = self.t[0] + 0.5 * width;
        // Interpolate; move a little towards the middle, so that both ends close in; stay near enough to the middle
        // for the bracket to keep up with bisection. The parameters are the paper's k1 = 0.2, k2 = 2, n0 = 1.
        let offset = middle - self.secant();
        let truncated = offset.signum() * (offset.abs() - 0.2 * width * width).max(0.0);
        let radius = (0.5f64.powi(step as i32) - 0.5 * width).max(0.0);
        middle - truncated.clamp(-radius, radius)
    }

    /// Takes in the value at a point of the bracket.
    fn narrow(&mut self, t: f64, value: f64) {
        let end = usize::from((value >= 0.0) == (self.values[1] >= 0.0));
        (self.t[end], self.values[end]) = (t, value);
    }
}

/// Refines crossings by at most `steps` evaluations each. Those on the cube's border stay: there is no surface there.
pub(super) fn refine_crossings<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    geometry: &GridGeometry,
    crossings: &mut [Crossing],
    steps: usize,
) -> Result<()> {
    let mut brackets: Vec<EdgeBracket> = crossings
        .iter()
        .enumerate()
        .filter(|(_, crossing)| !crossing.is_on_border(geometry))
        .map(|(index, crossing)| EdgeBracket { crossing: index, t: [0.0, 1.0], values: crossing.values.map(f64::from) })
        .collect();
    for step in 0..steps {
        let points: Vec<Vec3> = brackets
            .iter()
            .map(|bracket| {
                let crossing = &crossings[bracket.crossing];
                geometry.point(crossing.node, crossing.axis, bracket.next(step))
            })
            .collect();
        let mut values = sampler.values(&points)?.into_iter().map(f64::from);
        brackets.retain_mut(|bracket| {
            let crossing = &mut crossings[bracket.crossing];
            let t = bracket.next(step);
            let Some(value) = values.next() else { return false };
            let expected = bracket.secant();
            bracket.narrow(t, value);
            crossing.t = keep_off_nodes(bracket.secant());
            (bracket.secant() - expected).abs() > TOLERANCE
        });
    }
    Ok(())
}
