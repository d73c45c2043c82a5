//! Opacity and colour everywhere, and what a ray sees of them (Max 1995; Mildenhall et al., *NeRF*, 2020, equation 3).

use glam::Vec3;
use rayon::prelude::*;

use super::contracted_grid::{ContractedGrid, Place, contract, expand};
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

/// Nodes whose gradients are looked at together.
pub(super) const BLOCK: usize = 32;

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
pub(super) struct Sample {
    place: Place,
    /// From the ray's origin, object units.
    distance: f32,
}

/// What a sample contributes.
struct Lit {
    values: Values,
    /// The share of the light that it stops.
    alpha: f32,
    /// The share of all the ray's light that it stops.
    weight: f32,
}

/// What rays are sampled and composited in.
#[derive(Default)]
pub(super) struct Scratch {
    samples: Vec<Sample>,
    lit: Vec<Lit>,
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
        let of_node = |node| self.at(&self.grid.place(grid.position(node)));
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
        let corners = self.grid.corners();
        let is_dense: Vec<bool> = self.values.par_iter().map(|values| sigmoid(values[0]) > least).collect();
        let is_active = |node: usize| {
            self.is_seen[node] && self.grid.has_cell(node) && corners.iter().any(|offset| is_dense[node + offset])
        };
        self.is_active = (0..self.grid.len()).into_par_iter().map(is_active).collect();
    }

    fn at(&self, place: &Place) -> Values {
        let mut sum = [0.0; CHANNELS];
        for (offset, weight) in self.grid.corners().into_iter().zip(place.weights) {
            let values = &self.values[place.node + offset];
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        }
        sum
    }

    /// Places on a ray, a contracted spacing apart, the first of them `jitter` of that after its beginning; `direction` has length 1.
    fn sample(&self, origin: Vec3, direction: Vec3, jitter: f32, samples: &mut Vec<Sample>) {
        samples.clear();
        let (start, spacing) = (origin / HALF, self.grid.spacing());
        let inverse = direction.recip();
        let [one, other] = [-BEFORE, BEFORE].map(|side| (Vec3::splat(side) - start) * inverse);
        let (enter, leave) = (one.min(other).max_element(), one.max(other).min_element());
        let begin = if enter < leave && leave > 0.0 { enter } else { -start.dot(direction) };
        let mut along = begin.max(0.0);
        let mut skipped = jitter;
        loop {
            let point = start + along * direction;
            let norm = point.abs().max_element();
            if norm.is_nan() || norm > FAR {
                break;
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
            let place = self.grid.place(contracted);
            if self.is_active[place.node] {
                samples.push(Sample { place, distance: HALF * along });
            }
            along += step;
        }
    }

    /// How much light the samples of a ray stop, from the first on; the last stops all that is left.
    fn composite<'a>(&'a self, samples: &'a [Sample], least: f32) -> impl Iterator<Item = Lit> + 'a {
        let mut left = 1.0f32;
        samples.iter().enumerate().map_while(move |(i, sample)| {
            if left < DARK {
                return None;
            }
            let values = self.at(&sample.place);
            let alpha = sigmoid(values[0]);
            let alpha = if i + 1 == samples.len() {
                1.0
            } else if alpha < least {
                0.0
            } else {
                alpha
            };
            let weight = left * alpha;
            left *= 1.0 - alpha;
            Some(Lit { values, alpha, weight })
        })
    }

    /// The colour that a ray sees.
    #[cfg(test)]
    pub fn seen(&self, origin: Vec3, direction: Vec3, jitter: f32, Scratch { samples, .. }: &mut Scratch) -> Vec3 {
        self.sample(origin, direction, jitter, samples);
        self.composite(samples, 0.0).map(|lit| lit.weight * color(lit.values)).sum()
    }

    /// Adds the gradient of a loss of the colour that a ray sees, `slope`, by that colour.
    pub fn differentiate(
        &self,
        origin: Vec3,
        direction: Vec3,
        jitter: f32,
        slope: impl FnOnce(Vec3) -> Vec3,
        Scratch { samples, lit }: &mut Scratch,
        gradient: &mut Gradient,
    ) {
        self.sample(origin, direction, jitter, samples);
        lit.clear();
        lit.extend(self.composite(samples, 0.0));
        let slope = slope(lit.iter().map(|lit| lit.weight * color(lit.values)).sum());
        // What is seen behind a sample.
        let mut behind = Vec3::ZERO;
        for (i, (lit, sample)) in lit.iter().zip(&*samples).enumerate().rev() {
            let here = color(lit.values);
            let by_color = lit.weight * slope;
            let by_opacity =
                if i + 1 == samples.len() { 0.0 } else { lit.weight * (1.0 - lit.alpha) * slope.dot(here - behind) };
            behind = lit.alpha * here + (1.0 - lit.alpha) * behind;
            for (offset, weight) in self.grid.corners().into_iter().zip(sample.place.weights) {
                let node = sample.place.node + offset;
                gradient.is_touched[node / BLOCK] = true;
                let of_sample = [by_opacity, by_color.x, by_color.y, by_color.z];
                gradient.values[node].iter_mut().zip(of_sample).for_each(|(sum, by)| *sum += weight * by);
            }
        }
    }

    /// The share of a ray's light that surfaces stop where `is_object`, haze left out.
    pub fn object_share(
        &self,
        origin: Vec3,
        direction: Vec3,
        is_object: &dyn Fn(Vec3) -> bool,
        Scratch { samples, .. }: &mut Scratch,
    ) -> f32 {
        self.sample(origin, direction, 0.5, samples);
        let places = samples.iter().map(|sample| origin + sample.distance * direction);
        let of_object = self.composite(samples, HAZE).zip(places).filter(|(_, place)| is_object(*place));
        of_object.map(|(lit, _)| lit.weight).sum()
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
        let mut scratch = Scratch::default();
        let mut gradient = Gradient::zero(field.grid.len());
        field.differentiate(ORIGIN, direction, 0.3, |_| wanted, &mut scratch, &mut gradient);
        let mut compared = 0;
        for node in 0..field.grid.len() {
            assert!(gradient.is_touched[node / BLOCK] || gradient.values[node] == [0.0; CHANNELS]);
            for channel in 0..CHANNELS {
                let found = gradient.values[node][channel];
                let mut loss = |change: f32| {
                    let before = field.values[node][channel];
                    field.values[node][channel] += change;
                    let loss = field.seen(ORIGIN, direction, 0.3, &mut scratch).dot(wanted);
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
            field.object_share(ORIGIN, direction.normalize(), &is_wall, &mut Scratch::default())
        };
        assert!(share(Vec3::NEG_Z) > 0.99, "{}", share(Vec3::NEG_Z));
        assert!(share(Vec3::Z) < 0.01 && share(Vec3::new(1.0, 0.0, -0.2)) < 0.01);
    }
}
