//! Trilinear interpolation of many points at once, with everything that differentiation asks of it: values and their
//! derivatives along a direction, and the transposes of both, towards nodes, points and directions.
//!
//! Points outside the lattice's cube have the value of the nearest point of the cube, so their derivatives across its
//! border are zero. Numbers are `f32` or `f64`, each node has `C` channels side by side. Work is spread over threads,
//! and the results do not depend on how.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use pulp::Arch;
use rayon::prelude::*;

use crate::lattice::Lattice;

/// Points that a thread takes at once.
const CHUNK: usize = 1024;

/// A number to compute with: `f32` or `f64`.
pub trait Real:
    Copy
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + 'static
{
    /// 1.
    const ONE: Self;

    /// The number nearest to a double.
    fn from_f64(number: f64) -> Self;

    /// The whole number below, of one that is not negative.
    fn to_index(self) -> usize;
}

impl Real for f32 {
    const ONE: Self = 1.0;

    fn from_f64(number: f64) -> Self {
        number as Self
    }

    fn to_index(self) -> usize {
        self as usize
    }
}

impl Real for f64 {
    const ONE: Self = 1.0;

    fn from_f64(number: f64) -> Self {
        number
    }

    fn to_index(self) -> usize {
        self as usize
    }
}

/// A lattice as interpolation in numbers `T` needs it.
#[derive(Clone, Copy, Debug)]
struct Grid<T> {
    half_extent: T,
    per_cell: T,
    cells: T,
    last_cell: usize,
    nodes: usize,
    /// From a cell's lowest node to its corners, x fastest.
    offsets: [usize; 8],
}

/// Where a point lies in a grid.
#[derive(Clone, Copy, Debug)]
struct Place<T> {
    /// The cell's lowest node.
    node: usize,
    /// Position in the cell, each coordinate in `[0, 1]`.
    at: [T; 3],
    /// How the position changes with the point along each axis: cells a unit of length, 0 outside the cube.
    scale: [T; 3],
}

impl<T: Real> Grid<T> {
    fn new(lattice: &Lattice) -> Self {
        let (half_extent, cells) = (f64::from(lattice.half_extent()), lattice.cells() as f64);
        Self {
            half_extent: T::from_f64(half_extent),
            per_cell: T::from_f64(cells / (2.0 * half_extent)),
            cells: T::from_f64(cells),
            last_cell: lattice.cells() - 1,
            nodes: lattice.nodes(),
            offsets: lattice.corner_offsets(),
        }
    }

    #[inline(always)]
    fn place(&self, point: &[T; 3]) -> Place<T> {
        let zero = T::default();
        let (mut at, mut scale, mut low) = ([zero; 3], [zero; 3], [0; 3]);
        for axis in 0..3 {
            let position = (point[axis] + self.half_extent) * self.per_cell;
            let (held, rate) = if position > self.cells {
                (self.cells, zero)
            } else if position >= zero {
                (position, self.per_cell)
            } else {
                // What is not a number lies, like what is far below, in the first cell.
                (zero, zero)
            };
            low[axis] = held.to_index().min(self.last_cell);
            at[axis] = held - T::from_f64(low[axis] as f64);
            scale[axis] = rate;
        }
        Place { node: (low[2] * self.nodes + low[1]) * self.nodes + low[0], at, scale }
    }
}

impl<T: Real> Place<T> {
    /// What each corner, x fastest, adds to the value.
    #[inline(always)]
    fn weights(&self) -> [T; 8] {
        let [x, y, z] = self.at.map(|high| [T::ONE - high, high]);
        std::array::from_fn(|corner| x[corner & 1] * (y[corner >> 1 & 1] * z[corner >> 2]))
    }

    /// What each corner adds to the derivative along `direction`.
    #[inline(always)]
    fn slopes(&self, direction: &[T; 3]) -> [T; 8] {
        let [x, y, z] = self.at.map(|high| [T::ONE - high, high]);
        let [dx, dy, dz] = self.in_cells(direction).map(|d| [-d, d]);
        std::array::from_fn(|corner| {
            let (i, j, k) = (corner & 1, corner >> 1 & 1, corner >> 2);
            dx[i] * (y[j] * z[k]) + x[i] * (dy[j] * z[k] + y[j] * dz[k])
        })
    }

    /// A direction in cells.
    #[inline(always)]
    fn in_cells(&self, direction: &[T; 3]) -> [T; 3] {
        std::array::from_fn(|axis| direction[axis] * self.scale[axis])
    }

    /// The gradient, by the point, of the interpolation of one number a corner.
    #[inline(always)]
    fn gradient(&self, c: &[T; 8]) -> [T; 3] {
        let [x, y, z] = self.at;
        let by_x: [T; 4] = std::array::from_fn(|i| c[2 * i + 1] - c[2 * i]);
        let along_x: [T; 4] = std::array::from_fn(|i| c[2 * i] + by_x[i] * x);
        let gradient = [
            lerp(lerp(by_x[0], by_x[1], y), lerp(by_x[2], by_x[3], y), z),
            lerp(along_x[1] - along_x[0], along_x[3] - along_x[2], z),
            lerp(along_x[2], along_x[3], y) - lerp(along_x[0], along_x[1], y),
        ];
        self.in_cells(&gradient)
    }

    /// The gradient, by the point, of the derivative along `direction`: second derivatives times the direction. Those
    /// twice along one axis are zero.
    #[inline(always)]
    fn second_derivative(&self, c: &[T; 8], direction: &[T; 3]) -> [T; 3] {
        let [x, y, z] = self.at;
        let xy = lerp(c[3] - c[2] - c[1] + c[0], c[7] - c[6] - c[5] + c[4], z);
        let xz = lerp(c[5] - c[4] - c[1] + c[0], c[7] - c[6] - c[3] + c[2], y);
        let yz = lerp(c[6] - c[4] - c[2] + c[0], c[7] - c[5] - c[3] + c[1], x);
        let [dx, dy, dz] = self.in_cells(direction);
        self.in_cells(&[xy * dy + xz * dz, xy * dx + yz * dz, xz * dx + yz * dy])
    }

    /// The numbers at the corners, each node's channels weighted with `by_channel` and summed.
    #[inline(always)]
    fn corners<const C: usize>(&self, grid: &Grid<T>, values: &[[T; C]], by_channel: &[T; C]) -> [T; 8] {
        grid.offsets.map(|offset| {
            let node = &values[self.node + offset];
            node.iter().zip(by_channel).fold(T::default(), |sum, (&value, &by)| sum + value * by)
        })
    }
}

#[inline(always)]
fn lerp<T: Real>(a: T, b: T, t: T) -> T {
    a + (b - a) * t
}

/// The values at points.
///
/// # Panics
/// When there are not as many values as nodes.
pub fn interpolate<T: Real, const C: usize>(lattice: &Lattice, values: &[[T; C]], points: &[[T; 3]]) -> Vec<[T; C]> {
    let grid = checked(lattice, values);
    per_point(points.len(), [T::default(); C], |i| {
        let place = grid.place(&points[i]);
        weighted(&grid, values, place.node, &place.weights())
    })
}

/// The values at points, and their derivatives along a direction each.
///
/// # Panics
/// When there are not as many values as nodes, or as many directions as points.
pub fn interpolate_jet<T: Real, const C: usize>(
    lattice: &Lattice,
    values: &[[T; C]],
    points: &[[T; 3]],
    directions: &[[T; 3]],
) -> Vec<[[T; C]; 2]> {
    let grid = checked(lattice, values);
    per_point(points.len(), [[T::default(); C]; 2], |i| {
        let place = grid.place(&points[i]);
        [place.weights(), place.slopes(&directions[i])].map(|weights| weighted(&grid, values, place.node, &weights))
    })
}

/// From a gradient by the values at points (as [`interpolate`] gives them) to that by the points.
///
/// # Panics
/// When there are not as many values as nodes, or as many gradients as points.
pub fn points_gradient<T: Real, const C: usize>(
    lattice: &Lattice,
    values: &[[T; C]],
    points: &[[T; 3]],
    gradient: &[[T; C]],
) -> Vec<[T; 3]> {
    let grid = checked(lattice, values);
    per_point(points.len(), [T::default(); 3], |i| {
        let place = grid.place(&points[i]);
        place.gradient(&place.corners(&grid, values, &gradient[i]))
    })
}

/// From a gradient by values and derivatives (as [`interpolate_jet`] gives them) to those by the points and by the
/// directions.
///
/// # Panics
/// When there are not as many values as nodes, or as many directions and gradients as points.
pub fn jet_points_gradient<T: Real, const C: usize>(
    lattice: &Lattice,
    values: &[[T; C]],
    points: &[[T; 3]],
    directions: &[[T; 3]],
    gradient: &[[[T; C]; 2]],
) -> Vec<[[T; 3]; 2]> {
    let grid = checked(lattice, values);
    per_point(points.len(), [[T::default(); 3]; 2], |i| {
        let place = grid.place(&points[i]);
        let [by_value, by_derivative] = gradient[i].map(|by| place.corners(&grid, values, &by));
        let (first, second) = (place.gradient(&by_value), place.second_derivative(&by_derivative, &directions[i]));
        [std::array::from_fn(|axis| first[axis] + second[axis]), place.gradient(&by_derivative)]
    })
}

/// From a gradient by the values at points to that by the values at nodes: the transpose of [`interpolate`].
///
/// # Panics
/// When there are not as many gradients as points.
pub fn scatter<T: Real, const C: usize>(lattice: &Lattice, points: &[[T; 3]], gradient: &[[T; C]]) -> Vec<[T; C]> {
    scatter_by(lattice, points, |i, place| {
        let by = &gradient[i];
        place.weights().map(|weight| by.map(|by| weight * by))
    })
}

/// From a gradient by values and derivatives to that by the values at nodes: the transpose of [`interpolate_jet`].
///
/// # Panics
/// When there are not as many directions and gradients as points.
pub fn scatter_jet<T: Real, const C: usize>(
    lattice: &Lattice,
    points: &[[T; 3]],
    directions: &[[T; 3]],
    gradient: &[[[T; C]; 2]],
) -> Vec<[T; C]> {
    scatter_by(lattice, points, |i, place| {
        let ([by_value, by_derivative], slopes) = (&gradient[i], place.slopes(&directions[i]));
        let weights = place.weights();
        std::array::from_fn(|corner| {
            std::array::from_fn(|c| weights[corner] * by_value[c] + slopes[corner] * by_derivative[c])
        })
    })
}

fn checked<T: Real, const C: usize>(lattice: &Lattice, values: &[[T; C]]) -> Grid<T> {
    assert_eq!(values.len(), lattice.len(), "values at nodes");
    Grid::new(lattice)
}

/// The weighted sum of a cell's corners.
#[inline(always)]
fn weighted<T: Real, const C: usize>(grid: &Grid<T>, values: &[[T; C]], node: usize, weights: &[T; 8]) -> [T; C] {
    let mut sum = [T::default(); C];
    for (offset, &weight) in grid.offsets.iter().zip(weights) {
        let corner = &values[node + offset];
        (0..C).for_each(|c| sum[c] += weight * corner[c]);
    }
    sum
}

/// One answer a point, chunks of points in parallel, compiled for the instruction set at hand; `blank` is overwritten.
fn per_point<O: Copy + Send + Sync>(count: usize, blank: O, answer: impl Fn(usize) -> O + Sync) -> Vec<O> {
    let arch = Arch::new();
    let mut answers = vec![blank; count];
    answers.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, answers)| {
        arch.dispatch(|| {
            (CHUNK * chunk..).zip(answers.iter_mut()).for_each(
                #[inline(always)]
                |(point, blank)| *blank = answer(point),
            );
        });
    });
    answers
}

/// Adds what `corners` says of the eight corners of each point's cell.
///
/// Points are sorted into layers of cells. Each layer of nodes is one task: it adds up what the cells below and above
/// it say, in the order of the points.
fn scatter_by<T: Real, const C: usize>(
    lattice: &Lattice,
    points: &[[T; 3]],
    corners: impl Fn(usize, &Place<T>) -> [[T; C]; 8] + Sync,
) -> Vec<[T; C]> {
    let grid = Grid::<T>::new(lattice);
    let plane = grid.nodes * grid.nodes;
    let layers: Vec<u32> = per_point(points.len(), 0, |i| (grid.place(&points[i]).node / plane) as u32);
    // Where each layer's points begin in their order.
    let mut starts = vec![0usize; grid.nodes + 1];
    layers.iter().for_each(|&layer| starts[layer as usize + 1] += 1);
    (0..grid.nodes).for_each(|layer| starts[layer + 1] += starts[layer]);
    let (mut next, mut order) = (starts.clone(), vec![0u32; points.len()]);
    for (point, &layer) in layers.iter().enumerate() {
        order[next[layer as usize]] = point as u32;
        next[layer as usize] += 1;
    }
    let arch = Arch::new();
    let mut sums = vec![[T::default(); C]; lattice.len()];
    sums.par_chunks_mut(plane).enumerate().for_each(|(z, sums)| {
        // Upper corners of the cells below, lower corners of those above.
        for (below, high) in [(z.checked_sub(1), 4), (Some(z), 0)] {
            let Some(layer) = below else { continue };
            arch.dispatch(|| {
                for &point in &order[starts[layer]..starts[layer + 1]] {
                    let place = grid.place(&points[point as usize]);
                    let by_corner = corners(point as usize, &place);
                    let node = place.node - layer * plane;
                    for corner in 0..4 {
                        let sum = &mut sums[node + grid.offsets[corner]];
                        (0..C).for_each(|c| sum[c] += by_corner[corner + high][c]);
                    }
                }
            });
        }
    });
    sums
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const LATTICE: (usize, f32) = (7, 0.55);

    fn lattice() -> Lattice {
        Lattice::new(LATTICE.0, LATTICE.1)
    }

    fn random<const C: usize>(count: usize, seed: u64, reach: f64) -> Vec<[f64; C]> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(|_| std::array::from_fn(|_| rng.random_range(-reach..reach))).collect()
    }

    fn dot<const C: usize>(a: &[[f64; C]], b: &[[f64; C]]) -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| a * b).sum()
    }

    fn moved(points: &[[f64; 3]], directions: &[[f64; 3]], step: f64) -> Vec<[f64; 3]> {
        let add = |(p, d): (&[f64; 3], &[f64; 3])| std::array::from_fn(|axis| p[axis] + step * d[axis]);
        points.iter().zip(directions).map(add).collect()
    }

    #[test]
    fn values_are_those_of_the_lattice_inside_and_outside() {
        let (lattice, values) = (lattice(), random::<1>(343, 0, 1.0));
        let plain: Vec<f32> = values.iter().map(|value| value[0] as f32).collect();
        let points = random::<3>(3000, 1, 0.8);
        for (point, [value]) in points.iter().zip(interpolate(&lattice, &values, &points)) {
            let expected = lattice.value(&plain, Vec3::from_array(point.map(|x| x as f32)));
            assert!((value - f64::from(expected)).abs() < 1e-5, "{point:?}");
        }
        let nowhere = [[f64::NAN, 0.0, f64::INFINITY]];
        assert!(interpolate(&lattice, &values, &nowhere)[0][0].is_finite());
    }

    #[test]
    fn single_and_double_precision_agree() {
        let single = |numbers: &[[f64; 3]]| numbers.iter().map(|n| n.map(|x| x as f32)).collect::<Vec<_>>();
        let (values, points, directions) = (random::<3>(343, 0, 1.0), random(500, 1, 0.6), random(500, 2, 1.0));
        let double = interpolate_jet(&lattice(), &values, &points, &directions);
        let found = interpolate_jet(&lattice(), &single(&values), &single(&points), &single(&directions));
        for (a, b) in double.as_flattened().as_flattened().iter().zip(found.as_flattened().as_flattened()) {
            assert!((a - f64::from(*b)).abs() < 1e-4);
        }
    }

    #[test]
    fn derivatives_along_a_direction_are_those_of_differences() {
        let (values, points, directions) = (random::<3>(343, 3, 1.0), random(400, 4, 0.7), random(400, 5, 1.0));
        let at = |step| interpolate(&lattice(), &values, &moved(&points, &directions, step));
        let (above, below) = (at(1e-7), at(-1e-7));
        let jets = interpolate_jet(&lattice(), &values, &points, &directions);
        for (jet, (above, below)) in jets.iter().zip(above.iter().zip(&below)) {
            for c in 0..3 {
                assert!((jet[1][c] - (above[c] - below[c]) / 2e-7).abs() < 1e-5);
            }
        }
        let plain: Vec<[f64; 3]> = jets.iter().map(|jet| jet[0]).collect();
        assert_eq!(plain, interpolate(&lattice(), &values, &points));
    }

    #[test]
    fn gradients_by_nodes_are_the_transposes() {
        let (values, points, directions) = (random::<3>(343, 3, 1.0), random(2500, 4, 0.7), random(2500, 5, 1.0));
        let (by_value, by_derivative) = (random::<3>(2500, 6, 1.0), random::<3>(2500, 7, 1.0));
        let left = dot(&interpolate(&lattice(), &values, &points), &by_value);
        let right = dot(&values, &scatter(&lattice(), &points, &by_value));
        assert!((left - right).abs() < 1e-9 * left.abs(), "{left} {right}");
        let by: Vec<[[f64; 3]; 2]> = by_value.into_iter().zip(by_derivative).map(|(a, b)| [a, b]).collect();
        let left = dot(interpolate_jet(&lattice(), &values, &points, &directions).as_flattened(), by.as_flattened());
        let right = dot(&values, &scatter_jet(&lattice(), &points, &directions, &by));
        assert!((left - right).abs() < 1e-9 * left.abs(), "{left} {right}");
    }

    #[test]
    fn gradients_by_points_and_directions_are_those_of_differences() {
        let (values, points, directions) = (random::<3>(343, 3, 1.0), random(400, 4, 0.7), random(400, 5, 1.0));
        let by = random::<3>(800, 6, 1.0);
        let by: Vec<[[f64; 3]; 2]> = by.as_chunks::<2>().0.to_vec();
        let loss = |points: &[[f64; 3]], directions: &[[f64; 3]]| {
            dot(interpolate_jet(&lattice(), &values, points, directions).as_flattened(), by.as_flattened())
        };
        let found = jet_points_gradient(&lattice(), &values, &points, &directions, &by);
        let ways = random::<3>(400, 8, 1.0);
        let along = |part: usize| ways.iter().zip(&found).map(|(w, g)| dot(&[*w], &[g[part]])).sum::<f64>();
        let by_points =
            (loss(&moved(&points, &ways, 1e-8), &directions) - loss(&moved(&points, &ways, -1e-8), &directions)) / 2e-8;
        let by_directions =
            (loss(&points, &moved(&directions, &ways, 1e-3)) - loss(&points, &moved(&directions, &ways, -1e-3))) / 2e-3;
        assert!((along(0) - by_points).abs() < 1e-5 * by_points.abs(), "{} {by_points}", along(0));
        assert!((along(1) - by_directions).abs() < 1e-8 * by_directions.abs(), "{} {by_directions}", along(1));
        let values_alone: Vec<[f64; 3]> = by.iter().map(|by| by[0]).collect();
        let without = by.iter().map(|by| [by[0], [0.0; 3]]).collect::<Vec<_>>();
        let first: Vec<[f64; 3]> = points_gradient(&lattice(), &values, &points, &values_alone);
        let jets = jet_points_gradient(&lattice(), &values, &points, &directions, &without);
        assert_eq!(first, jets.iter().map(|jet| jet[0]).collect::<Vec<_>>());
    }

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        let (points, by) = (random::<3>(5000, 4, 0.6), random::<1>(5000, 6, 1.0));
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| scatter(&lattice(), &points, &by))
        };
        assert_eq!(with(1), with(5));
    }
}
