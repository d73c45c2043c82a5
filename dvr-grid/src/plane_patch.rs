//! Patches of a photograph on a plane, compared with what other photographs show there.

use glam::{Vec3, Vec4};
use pulp::{Arch, NullaryFnOnce};

use crate::views::TrainingView;

/// Samples along the side of a patch, and all.
pub(crate) const SIDE: usize = 5;
pub(crate) const SAMPLES: usize = SIDE * SIDE;

/// Samples from the middle to the side.
pub(crate) const REACH: u32 = SIDE as u32 / 2;

/// Variance of brightness that noise alone may have, about that of a level of eight bits: patches with less say nothing.
pub(crate) const NOISE: f32 = 2e-5;

/// How much nearer or farther than the middle of a patch a sample may lie, as a factor: planes seen edge-on reach too
/// far.
pub(crate) const MAX_STRETCH: f32 = 1.15;

/// Samples, filled up to whole vectors: what is computed of all of them is computed of many at once.
const LANES: usize = 32;

/// A number of each sample.
type Lanes = [f32; LANES];

/// Brightnesses around a pixel, and the points of the surface's tangent plane that they are seen at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlanePatch {
    /// By axis.
    points: [Lanes; 3],
    /// How they move on their rays as the plane moves along the middle one, by axis.
    motions: [Lanes; 3],
    brightness: Centered,
}

/// Brightnesses less their mean, zero beyond the samples, and their variance.
#[derive(Clone, Copy, Debug)]
struct Centered {
    values: Lanes,
    mean: f32,
    variance: f32,
}

/// How alike two patches are, and how that changes as the surface moves along the ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Likeness {
    /// Normalised cross-correlation, in `[-1, 1]`.
    pub correlation: f32,
    /// Its derivative by the ray depth of the plane.
    pub derivative: f32,
    /// How bright the other view shows the patch, in the mean.
    pub seen: f32,
}

impl PlanePatch {
    /// Variance of brightness around a pixel beyond that of a ramp, which is alike wherever it is carried; zero where
    /// not all of the patch shows the object.
    pub fn contrast(view: &TrainingView, pixel: [u32; 2]) -> f32 {
        let Some(brightness) = view.brightness_around::<SIDE, SAMPLES>(pixel, 1) else { return 0.0 };
        let (mut sums, mut squares) = ([0.0f32; 3], 0.0);
        for (i, found) in brightness.into_iter().enumerate() {
            let (du, dv) = ((i % SIDE) as f32 - REACH as f32, (i / SIDE) as f32 - REACH as f32);
            [found, found * du, found * dv].into_iter().zip(&mut sums).for_each(|(term, sum)| *sum += term);
            squares += found * found;
        }
        // The mean and the two slopes are orthogonal on the patch; these are the squares of their patterns.
        let across = SIDE as f32 * (0..SIDE).map(|i| (i as f32 - REACH as f32).powi(2)).sum::<f32>();
        let explained = sums[0] * sums[0] / SAMPLES as f32 + (sums[1] * sums[1] + sums[2] * sums[2]) / across;
        ((squares - explained) / SAMPLES as f32).max(0.0)
    }

    /// The patch around `pixel` of `view`, whose camera is at `origin`, on the plane through `point` with this normal
    /// (of either sign); `None` at the object's outline and where the plane is seen edge-on.
    pub fn on_plane(
        view: &TrainingView,
        pixel: [u32; 2],
        stride: u32,
        origin: Vec3,
        point: Vec3,
        normal: Vec3,
    ) -> Option<Self> {
        Arch::new().dispatch(OnPlane { view, pixel, stride, origin, point, normal })
    }

    /// How bright it is in the mean.
    pub fn mean(&self) -> f32 {
        self.brightness.mean
    }

    /// Compares with what another view shows at the same points; `None` where it does not show all of them.
    pub fn compare(&self, view: &TrainingView) -> Option<Likeness> {
        Arch::new().dispatch(Compare { patch: self, view })
    }
}

/// See [`PlanePatch::on_plane`].
struct OnPlane<'a> {
    view: &'a TrainingView<'a>,
    pixel: [u32; 2],
    stride: u32,
    origin: Vec3,
    point: Vec3,
    normal: Vec3,
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for OnPlane<'_> {
    type Output = Option<PlanePatch>;

    #[allow(clippy::needless_range_loop, reason = "loops over lanes are compiled to vectors")]
    #[inline(always)]
    fn call(self) -> Option<PlanePatch> {
        let Self { view, pixel: [u, v], stride, origin, point, normal } = self;
        let brightness = view.brightness_around::<SIDE, LANES>([u, v], stride)?;
        let height = normal.dot(point - origin);
        let middle = view.direction(u, v);
        let slope = normal.dot(middle);
        let depth = height / slope;
        // Directions are linear in the pixel.
        let [by_column, by_row] = [0, 1].map(|axis| stride as f32 * view.camera.to_direction.col(axis));
        let (mut points, mut motions) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        let mut is_near = true;
        for i in 0..LANES {
            let direction: [f32; 3] =
                std::array::from_fn(|axis| middle[axis] + COLUMNS[i] * by_column[axis] + ROWS[i] * by_row[axis]);
            let approach = normal.x * direction[0] + normal.y * direction[1] + normal.z * direction[2];
            let (ray_depth, motion) = (height / approach, slope / approach);
            let stretch = ray_depth / depth;
            is_near &= (stretch < MAX_STRETCH) & (stretch * MAX_STRETCH > 1.0);
            for axis in 0..3 {
                points[axis][i] = origin[axis] + ray_depth * direction[axis];
                motions[axis][i] = motion * direction[axis];
            }
        }
        is_near.then(|| PlanePatch { points, motions, brightness: Centered::new(brightness) })
    }
}

/// See [`PlanePatch::compare`].
struct Compare<'a> {
    patch: &'a PlanePatch,
    view: &'a TrainingView<'a>,
}

/// Compiled for each instruction set: a closure would not be.
impl NullaryFnOnce for Compare<'_> {
    type Output = Option<Likeness>;

    #[inline(always)]
    fn call(self) -> Option<Likeness> {
        let PlanePatch { points, motions, brightness } = self.patch;
        let (seen, moves) = self.view.reproject_brightness::<SAMPLES, LANES>(points, motions)?;
        let seen = Centered::new(seen);
        let scale = ((brightness.variance + NOISE) * (seen.variance + NOISE)).sqrt();
        let correlation = mean_product(&brightness.values, &seen.values) / scale;
        // With centred values, derivatives need not be centred: their mean falls out of the sums.
        let derivative = mean_product(&brightness.values, &moves) / scale
            - correlation * mean_product(&seen.values, &moves) / (seen.variance + NOISE);
        Some(Likeness { correlation, derivative, seen: seen.mean })
    }
}

impl Centered {
    /// Of samples; what lies beyond them does not count.
    #[inline(always)]
    fn new(mut values: Lanes) -> Self {
        values[SAMPLES..].fill(0.0);
        let mean = sum(&values) / SAMPLES as f32;
        for values in values.as_chunks_mut().0 {
            *values = (Vec4::from_array(*values) - mean).to_array();
        }
        values[SAMPLES..].fill(0.0);
        Self { variance: mean_product(&values, &values), values, mean }
    }
}

/// The mean product of samples, of which one is zero beyond them.
#[inline(always)]
fn mean_product(a: &Lanes, b: &Lanes) -> f32 {
    let fours = |values: &Lanes, i: usize| Vec4::from_slice(&values[4 * i..]);
    sum_of_fours(|i| fours(a, i) * fours(b, i)) / SAMPLES as f32
}

#[inline(always)]
fn sum(values: &Lanes) -> f32 {
    sum_of_fours(|i| Vec4::from_slice(&values[4 * i..]))
}

/// The sum over lanes, of which four are given at a time, in an order that is that of vectors of eight.
#[inline(always)]
fn sum_of_fours(fours: impl Fn(usize) -> Vec4) -> f32 {
    let half = |i: usize| (fours(i) + fours(i + 2)) + (fours(i + 4) + fours(i + 6));
    let [a, b, c, d] = (half(0) + half(1)).to_array();
    (a + c) + (b + d)
}

/// How far each sample lies from the middle, in strides; beyond the samples, in the middle.
const COLUMNS: Lanes = places(false);
const ROWS: Lanes = places(true);

const fn places(of_rows: bool) -> Lanes {
    let mut places = [0.0; LANES];
    let mut i = 0;
    while i < SAMPLES {
        places[i] = (if of_rows { i / SIDE } else { i % SIDE }) as f32 - REACH as f32;
        i += 1;
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    fn speckles() -> Fixture {
        Fixture::speckled_ball(0.3, GridLosses::default())
    }

    /// The pixel of a patch's sample.
    fn sample([u, v]: [u32; 2], i: usize, stride: u32) -> [u32; 2] {
        let by = |place: usize| place as i64 * i64::from(stride) - 2 * i64::from(stride);
        [i64::from(u) + by(i % 5), i64::from(v) + by(i / 5)].map(|at| at.try_into().unwrap())
    }

    /// The brightness of a photograph in double precision.
    fn brightness(view: &TrainingView, [u, v]: [u32; 2]) -> f64 {
        f64::from(view.brightness(u, v).unwrap())
    }

    #[test]
    fn contrast_is_what_a_ramp_does_not_explain() {
        let fixture = speckles();
        let view = &fixture.views[0];
        for pixel @ [u, v] in [[48, 48], [40, 55], [60, 37], [52, 61]] {
            // Least squares by hand: the mean and the two slopes are taken off one after the other.
            let mut rest: Vec<f64> = (0..SAMPLES).map(|i| brightness(view, sample(pixel, i, 1))).collect();
            let patterns: [fn(usize) -> f64; 3] = [|_| 1.0, |i| (i % 5) as f64 - 2.0, |i| (i / 5) as f64 - 2.0];
            for pattern in patterns {
                let squares: f64 = (0..SAMPLES).map(|i| pattern(i).powi(2)).sum();
                let share = (0..SAMPLES).map(|i| pattern(i) * rest[i]).sum::<f64>() / squares;
                rest.iter_mut().enumerate().for_each(|(i, rest)| *rest -= share * pattern(i));
            }
            let expected = rest.iter().map(|rest| rest * rest).sum::<f64>() / SAMPLES as f64;
            let found = f64::from(PlanePatch::contrast(view, [u, v]));
            assert!(expected > 1e-5 && (found - expected).abs() < 1e-6, "{pixel:?}: {found}, not {expected}");
        }
        assert_eq!(PlanePatch::contrast(view, [3, 3]), 0.0, "background");
    }

    /// The points of a patch, or how they move.
    fn by_sample(by_axis: &[Lanes; 3]) -> [Vec3; SAMPLES] {
        std::array::from_fn(|i| Vec3::new(by_axis[0][i], by_axis[1][i], by_axis[2][i]))
    }

    /// The patch of a pixel on a plane that its ray meets at this depth.
    fn on_plane(view: &TrainingView, pixel: [u32; 2], depth: f32, normal: Vec3) -> Option<PlanePatch> {
        on_plane_apart(view, pixel, 1, depth, normal)
    }

    /// The same with samples that lie this many pixels apart.
    fn on_plane_apart(
        view: &TrainingView,
        pixel: [u32; 2],
        stride: u32,
        depth: f32,
        normal: Vec3,
    ) -> Option<PlanePatch> {
        let point = view.camera.center + depth * view.direction(pixel[0], pixel[1]);
        PlanePatch::on_plane(view, pixel, stride, view.camera.center, point, normal)
    }

    /// A plane that faces the cameras, a little turned.
    const NORMAL: Vec3 = Vec3::new(0.35, -0.25, 0.9);

    #[test]
    fn a_patch_lies_on_its_plane_where_its_pixels_look_and_moves_on_their_rays() {
        let fixture = speckles();
        let (view, pixel) = (&fixture.views[1], [50, 45]);
        for (normal, stride) in [(NORMAL, 1), (-NORMAL, 1), (NORMAL, 3)] {
            let middle = view.camera.center + 1.3 * view.direction(50, 45);
            let [near, patch, far] =
                [1.29, 1.3, 1.31].map(|depth| on_plane_apart(view, pixel, stride, depth, normal).unwrap());
            let [points, nearer, farther] = [&patch, &near, &far].map(|patch| by_sample(&patch.points));
            let motions = by_sample(&patch.motions);
            for i in 0..SAMPLES {
                assert!(normal.dot(points[i] - middle).abs() < 1e-5);
                let seen = view.camera.project(points[i]).0 - glam::Vec2::splat(0.5);
                let [u, v] = sample(pixel, i, stride);
                assert!(seen.distance(glam::Vec2::new(u as f32, v as f32)) < 1e-2, "{seen}");
                let difference = (farther[i] - nearer[i]) / 0.02;
                assert!(motions[i].distance(difference) < 1e-3, "{} and {difference}", motions[i]);
            }
        }
    }

    #[test]
    fn a_plane_that_is_seen_edge_on_has_no_patch() {
        let fixture = speckles();
        let view = &fixture.views[0];
        let across = view.direction(49, 48) - view.direction(47, 48);
        let ahead = view.direction(48, 48);
        // How much nearer or farther the outermost column is.
        let stretched = |most: f32| {
            let turn = (most - 1.0) / most;
            let normal = ahead.normalize() - turn * across / across.length_squared() * ahead.length();
            let patch = on_plane(view, [48, 48], 1.3, normal);
            let reach = patch.map(|patch| {
                let depths = by_sample(&patch.points)
                    .map(|point| (point - view.camera.center).dot(ahead) / ahead.length_squared() / 1.3);
                depths.iter().fold(1.0f32, |most, depth| most.max(*depth).max(depth.recip()))
            });
            (reach, normal)
        };
        let (reach, normal) = stretched(1.1);
        assert!(reach.is_some_and(|reach| (1.05..MAX_STRETCH).contains(&reach)), "{reach:?} {normal}");
        for most in [1.25, 1.6] {
            assert_eq!(stretched(most).0, None, "{most}");
            // Mirrored, so that either side may be the far one.
            let normal = 2.0 * ahead.normalize() * ahead.normalize().dot(stretched(most).1) - stretched(most).1;
            assert!(on_plane(view, [48, 48], 1.3, normal).is_none(), "{most}");
        }
    }

    #[test]
    fn likeness_is_the_correlation_and_its_derivative_that_of_a_plane_that_moves() {
        let fixture = speckles();
        let (own, other) = (&fixture.views[0], &fixture.views[1]);
        let mut compared = 0;
        for pixel in [[48, 48], [44, 52], [53, 46], [50, 55], [46, 43]] {
            let at = |depth: f32| on_plane(own, pixel, depth, NORMAL).unwrap().compare(other).unwrap();
            let patch = on_plane(own, pixel, 1.31, NORMAL).unwrap();
            let found = at(1.31);
            // Both patches in double precision.
            let own: Vec<f64> = (0..SAMPLES).map(|i| brightness(own, sample(pixel, i, 1))).collect();
            let points = by_sample(&patch.points);
            let color = |i: usize| other.reproject(points[i], Vec3::X).unwrap().color;
            let seen: Vec<f64> = (0..SAMPLES).map(|i| f64::from(color(i).element_sum()) / 3.0).collect();
            let mean = |values: &[f64]| values.iter().sum::<f64>() / SAMPLES as f64;
            let covariance = |a: &[f64], b: &[f64]| {
                let product = |(x, y): (&f64, &f64)| (x - mean(a)) * (y - mean(b));
                a.iter().zip(b).map(product).sum::<f64>() / SAMPLES as f64
            };
            let noise = f64::from(NOISE);
            let scale = ((covariance(&own, &own) + noise) * (covariance(&seen, &seen) + noise)).sqrt();
            let expected = covariance(&own, &seen) / scale;
            assert!((f64::from(found.correlation) - expected).abs() < 1e-4, "{found:?}, not {expected}");
            let step = 2e-4;
            let difference = (at(1.31 + step).correlation - at(1.31 - step).correlation) / (2.0 * step);
            // A sample that steps over a pixel's border bends the difference.
            compared += usize::from((found.derivative - difference).abs() < 0.03 * difference.abs() + 0.05);
        }
        assert!(compared >= 4, "{compared} of 5");
    }
}
