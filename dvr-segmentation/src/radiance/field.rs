//! Opacity and colour everywhere, and what a ray sees of them (Max 1995; Mildenhall et al., *NeRF*, 2020, equation 3).

use glam::Vec3;
use rayon::prelude::*;

use super::contracted_grid::{BRICK_NODES, Cell, ContractedGrid, contract, expand};
use crate::HALF;
use crate::shrunk::Shrunk;

/// How far out the field is, half edges of the cube.
const FAR: f32 = 30.0;

/// Nothing is before the cube: rays begin where they enter one so many times as large, or, where they miss it, where they come
/// nearest to its middle.
const BEFORE: f32 = 1.15;

/// Views that must have a place in their frames: one view's picture could be explained by anything right before it.
const MIN_SEEING: usize = 3;

/// What less of a ray's light than this reaches does not count.
const DARK: f32 = 1e-3;

/// A sample that stops less of a ray's light than this belongs to no surface.
const HAZE: f32 = 0.1;

/// Samples whose numbers are looked up together: the processor fetches the next ones' while it waits for the first.
const AHEAD: usize = 16;

/// Nodes whose gradients are looked at together.
pub(super) const BLOCK: usize = BRICK_NODES;

/// Numbers of a node: the logit of its opacity, which is what it stops of a ray's light within a spacing, and a colour.
pub(super) const CHANNELS: usize = 4;
pub(super) type Values = [f32; CHANNELS];

/// Opacity and colour at the nodes of a grid.
pub(super) struct RadianceField {
    pub grid: ContractedGrid,
    pub values: Vec<Values>,
    /// Cells that are looked at, by their first corners: those that enough views see, and that are not empty.
    is_active: Vec<bool>,
    /// Nodes that enough views see.
    is_seen: Vec<bool>,
}

/// A place on a ray.
struct Sample {
    cell: Cell,
    /// From the ray's origin, object units.
    distance: f32,
}

/// What a sample contributes.
pub(super) struct Lit {
    sample: Sample,
    /// The field's numbers there, and, on the way back, their gradient.
    values: Values,
    /// The share of the light that it stops.
    alpha: f32,
    /// The share of all the ray's light that it stops.
    weight: f32,
}

/// A gradient at the nodes.
pub(super) struct Gradient {
    pub values: Vec<Values>,
    /// Blocks of [`BLOCK`] nodes in which it may differ from 0.
    pub is_touched: Vec<bool>,
}

impl Gradient {
    pub fn zero(nodes: usize) -> Self {
        Self { values: vec![[0.0; CHANNELS]; nodes], is_touched: vec![false; nodes.div_ceil(BLOCK)] }
    }
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The colour in a node's numbers.
fn color([_, r, g, b]: Values) -> Vec3 {
    Vec3::new(r, g, b)
}

impl RadianceField {
    /// The same numbers everywhere.
    pub fn constant(grid: ContractedGrid, values: Values, views: &[&Shrunk]) -> Self {
        Self::new(grid, vec![values; grid.len()], views)
    }

    /// The same field on another grid.
    pub fn on(&self, grid: ContractedGrid, views: &[&Shrunk]) -> Self {
        let of_node = |node| self.at(&self.grid.cell(grid.position(node)));
        Self::new(grid, (0..grid.len()).into_par_iter().map(of_node).collect(), views)
    }

    fn new(grid: ContractedGrid, values: Vec<Values>, views: &[&Shrunk]) -> Self {
        let is_seen = |node| {
            let point = HALF * expand(grid.position(node), FAR);
            let sees = |view: &&&Shrunk| {
                let (place, z) = view.camera.project(point);
                z > 0.0 && view.pixel_at(place).is_some()
            };
            views.iter().filter(sees).take(MIN_SEEING).count() == MIN_SEEING
        };
        let is_seen: Vec<bool> = (0..grid.len()).into_par_iter().map(is_seen).collect();
        Self { grid, values, is_active: is_seen.clone(), is_seen }
    }

    /// Leaves out cells that stop at most a share `least` of the light at all corners.
    pub fn skip_empty(&mut self, least: f32) {
        let is_dense: Vec<bool> = self.values.par_iter().map(|values| sigmoid(values[0]) > least).collect();
        let has_dense =
            |node| self.grid.corners(node).is_some_and(|corners| corners.into_iter().any(|at| is_dense[at]));
        let is_active = |node: usize| self.is_seen[node] && has_dense(node);
        self.is_active = (0..self.grid.len()).into_par_iter().map(is_active).collect();
    }

    #[inline]
    fn at(&self, cell: &Cell) -> Values {
        let mut sum = [0.0; CHANNELS];
        for (corner, weight) in cell.corners().into_iter().zip(cell.weights()) {
            let values = &self.values[corner];
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        }
        sum
    }

    /// Places on a ray, a contracted spacing apart, the first of them `jitter` of that after its beginning; `direction` has length 1.
    fn samples(&self, origin: Vec3, direction: Vec3, jitter: f32) -> impl Iterator<Item = Sample> + '_ {
        let (start, spacing) = (origin / HALF, self.grid.spacing());
        let inverse = direction.recip();
        let [one, other] = [-BEFORE, BEFORE].map(|side| (Vec3::splat(side) - start) * inverse);
        let (enter, leave) = (one.min(other).max_element(), one.max(other).min_element());
        let begin = if enter < leave && leave > 0.0 { enter } else { -start.dot(direction) };
        let mut along = begin.max(0.0);
        let mut skipped = jitter;
        std::iter::from_fn(move || {
            loop {
                let point = start + along * direction;
                let norm = point.abs().max_element();
                if norm.is_nan() || norm > FAR {
                    return None;
                }
                let (contracted, step) = if norm <= 1.0 {
                    (point, spacing)
                } else {
                    let (contracted, change) = contract(point, direction);
                    (contracted, (spacing / change.length().max(1e-6)).min(0.5 * norm))
                };
                if skipped > 0.0 {
                    along += skipped * step;
                    skipped = 0.0;
                    continue;
                }
                let distance = HALF * along;
                along += step;
                let cell = self.grid.cell(contracted);
                if self.is_active[cell.node] {
                    return Some(Sample { cell, distance });
                }
            }
        })
    }

    /// What the samples of a ray contribute, from the first on, as far as there is light; the last stops all that is left.
    /// What stops less than `least` stops nothing. `lit` is replaced by it.
    fn composite(&self, samples: impl Iterator<Item = Sample>, least: f32, lit: &mut Vec<Lit>) {
        lit.clear();
        let mut samples = samples.peekable();
        let mut left = 1.0f32;
        while samples.peek().is_some() {
            let first = lit.len();
            let unlit = |sample| Lit { sample, values: [0.0; CHANNELS], alpha: 0.0, weight: 0.0 };
            lit.extend(samples.by_ref().take(AHEAD).map(unlit));
            for lit in &mut lit[first..] {
                lit.values = self.at(&lit.sample.cell);
            }
            for i in first..lit.len() {
                if left < DARK {
                    lit.truncate(i);
                    return;
                }
                let alpha = sigmoid(lit[i].values[0]);
                let alpha = if i + 1 == lit.len() && samples.peek().is_none() {
                    1.0
                } else if alpha < least {
                    0.0
                } else {
                    alpha
                };
                (lit[i].alpha, lit[i].weight) = (alpha, left * alpha);
                left *= 1.0 - alpha;
            }
        }
    }

    /// The colour that a ray sees.
    #[cfg(test)]
    pub fn seen(&self, origin: Vec3, direction: Vec3, jitter: f32) -> Vec3 {
        let mut lit = Vec::new();
        self.composite(self.samples(origin, direction, jitter), 0.0, &mut lit);
        lit.iter().map(|lit| lit.weight * color(lit.values)).sum()
    }

    /// Adds the gradient of a loss of the colour that a ray sees, `slope`, by that colour. `lit` is memory
    /// to be used again.
    pub fn differentiate(
        &self,
        origin: Vec3,
        direction: Vec3,
        jitter: f32,
        slope: impl FnOnce(Vec3) -> Vec3,
        lit: &mut Vec<Lit>,
        gradient: &mut Gradient,
    ) {
        self.composite(self.samples(origin, direction, jitter), 0.0, lit);
        let slope = slope(lit.iter().map(|lit| lit.weight * color(lit.values)).sum());
        // What is seen behind a sample.
        let mut behind = Vec3::ZERO;
        for lit in lit.iter_mut().rev() {
            let here = color(lit.values);
            let by_color = lit.weight * slope;
            // Of the last sample, which stops everything, 0.
            let by_opacity = lit.weight * (1.0 - lit.alpha) * slope.dot(here - behind);
            behind = lit.alpha * here + (1.0 - lit.alpha) * behind;
            lit.values = [by_opacity, by_color.x, by_color.y, by_color.z];
        }
        // By itself: as with `AHEAD`, memory is what this waits for.
        for lit in lit.iter().rev() {
            for (node, weight) in lit.sample.cell.corners().into_iter().zip(lit.sample.cell.weights()) {
                gradient.is_touched[node / BLOCK] = true;
                gradient.values[node].iter_mut().zip(lit.values).for_each(|(sum, by)| *sum += weight * by);
            }
        }
    }

    /// The share of a ray's light that surfaces stop where `is_object`, haze left out. `lit` is memory to be used
    /// again.
    pub fn object_share(
        &self,
        origin: Vec3,
        direction: Vec3,
        is_object: &dyn Fn(Vec3) -> bool,
        lit: &mut Vec<Lit>,
    ) -> f32 {
        self.composite(self.samples(origin, direction, 0.5), HAZE, lit);
        let of_object = lit.iter().filter(|lit| is_object(origin + lit.sample.distance * direction));
        of_object.map(|lit| lit.weight).sum()
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const ORIGIN: Vec3 = Vec3::new(0.2, -0.1, 1.4);

    /// A field of random numbers that is looked at everywhere.
    fn field(rng: &mut ChaCha8Rng) -> RadianceField {
        let grid = ContractedGrid::new(9);
        let values =
            (0..grid.len()).map(|_| [rng.random::<f32>() * 4.0 - 4.0, rng.random(), rng.random(), rng.random()]);
        let all = vec![true; grid.len()];
        RadianceField { grid, values: values.collect(), is_active: all.clone(), is_seen: all }
    }

    #[test]
    fn gradients_are_those_of_differences() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut field = field(&mut rng);
        let (direction, wanted) = (Vec3::new(-0.1, 0.15, -1.0).normalize(), Vec3::new(0.3, -0.5, 0.9));
        let mut gradient = Gradient::zero(field.grid.len());
        field.differentiate(ORIGIN, direction, 0.3, |_| wanted, &mut Vec::new(), &mut gradient);
        let mut compared = 0;
        for node in 0..field.grid.len() {
            assert!(gradient.is_touched[node / BLOCK] || gradient.values[node] == [0.0; CHANNELS]);
            for channel in 0..CHANNELS {
                let found = gradient.values[node][channel];
                let mut loss = |change: f32| {
                    let before = field.values[node][channel];
                    field.values[node][channel] += change;
                    let loss = field.seen(ORIGIN, direction, 0.3).dot(wanted);
                    field.values[node][channel] = before;
                    loss
                };
                let differences = (loss(0.01) - loss(-0.01)) / 0.02;
                assert!((found - differences).abs() < 2e-4, "{node} {channel}: {found} {differences}");
                compared += usize::from(found.abs() > 1e-3);
            }
        }
        assert!(compared > 50, "{compared}");
    }

    #[test]
    fn a_ray_sees_what_is_in_the_cube_and_through_haze() {
        let grid = ContractedGrid::new(31);
        // A wall before z = 0 in the cube, in haze.
        let of_node = |node| {
            let is_wall = grid.position(node).abs().max_element() < 1.0 && grid.position(node).z < 0.0;
            [if is_wall { 8.0 } else { -4.0 }, 0.5, 0.5, 0.5]
        };
        let all = vec![true; grid.len()];
        let values = (0..grid.len()).map(of_node).collect();
        let field = RadianceField { grid, values, is_active: all.clone(), is_seen: all };
        let share = |direction: Vec3| {
            let is_wall = |point: Vec3| point.abs().max_element() < HALF && point.z < 0.05;
            field.object_share(ORIGIN, direction.normalize(), &is_wall, &mut Vec::new())
        };
        assert!(share(Vec3::NEG_Z) > 0.99, "{}", share(Vec3::NEG_Z));
        assert!(share(Vec3::Z) < 0.01 && share(Vec3::new(1.0, 0.0, -0.2)) < 0.01);
    }
}
