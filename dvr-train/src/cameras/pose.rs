//! One camera against a field: where it stands when its photograph and its outline are explained best.
//!
//! The camera is moved by `X_c -> exp(w) R X + t + u`: it turns about the object by `w`, and the object is shifted in
//! front of it by `u`. Around the object's centre these hardly depend on each other, whereas turning a camera on the
//! spot and stepping aside look almost alike. A third number, the gain, is how bright the photograph is beside the
//! field.
//!
//! Two kinds of residuals, both with their derivative in closed form: the photograph at the projection of a surface
//! point against the field's colour there (the point is held, its projection moves); and rays through pixels along the
//! outline, whose largest signed distance must be that of the pixel. The derivative of that largest value is the one at
//! its place (envelope theorem), as the depth's is the one at its crossing.

use dvr_core::hull::MaskDistance;
use dvr_core::voxel::VoxelTraversal;
use dvr_core::{Camera, View};
use dvr_grid::GridField;
use dvr_render::Shader;
use glam::{DMat3, DVec2, DVec3, Vec3};
use nalgebra::{SMatrix, SVector};

use super::photograph::SmoothPhotograph;

/// Rays through the object, at most.
const INTERIOR: usize = 1500;

/// Rays along the outline, at most.
const OUTLINE: usize = 600;

/// How far from the outline its rays are, pixels outwards and inwards: a ray deep inside says nothing of the outline.
const OUTLINE_BAND: [f32; 2] = [1.5, 0.5];

/// Gauss-Newton steps.
const STEPS: usize = 4;

/// Residuals are taken for outliers from so many standard deviations on (Cauchy's weight).
const OUTLIER: f64 = 2.0;

/// Standard deviations are at least this, in pixels and in colours: nothing is known better.
const LEAST_DEVIATION: [f64; 2] = [0.1, 0.01];

/// The standard deviation of outlines is at most this, in cells (or half a pixel): where a camera is farther off, that
/// is its fault, and the texture must not hold it there.
const LARGEST_OUTLINE_DEVIATION: f64 = 0.3;

/// How far cameras are expected to be from where they are given: radians, shares of the distance, and the logarithm of
/// the gain.
const EXPECTED: [f64; 3] = [0.05, 0.05, 0.3];

/// Neighbouring pixels tell much the same: so many count as one against what is expected.
const REDUNDANCY: f64 = 20.0;

/// The pixels of a view that tell its camera.
#[derive(Clone, Debug)]
pub(super) struct Marks {
    /// Inside the object, with the distance to the outline.
    interior: Vec<(u32, u32, f32)>,
    /// Along the outline, with the distance to it, positive inside.
    outline: Vec<(u32, u32, f32)>,
}

impl Marks {
    /// Chooses them.
    pub fn new(view: &View) -> Self {
        let Some(mask) = view.training_mask() else { return Self { interior: Vec::new(), outline: Vec::new() } };
        let distances = MaskDistance::new(&view.camera, mask);
        let (width, height) = mask.size();
        let pixels = || (0..height).flat_map(move |v| (0..width).map(move |u| (u, v)));
        let [outwards, inwards] = OUTLINE_BAND;
        // At the border of the frame, the mask's end is not the object's.
        let framed = |u: u32, v: u32| u > 1 && v > 1 && u + 2 < width && v + 2 < height;
        let outline = pixels().filter(|&(u, v)| framed(u, v)).map(|(u, v)| (u, v, distances.of_pixel(u, v)));
        let interior = pixels().filter(|&(u, v)| mask.is_object(u, v)).map(|(u, v)| (u, v, distances.of_pixel(u, v)));
        Self {
            interior: thinned(interior.filter(|&(_, _, s)| s > inwards).collect(), INTERIOR),
            outline: thinned(outline.filter(|&(_, _, s)| s > -outwards && s < inwards).collect(), OUTLINE),
        }
    }
}

/// Every so many-th, so that at most `most` are left.
fn thinned<T: Copy>(all: Vec<T>, most: usize) -> Vec<T> {
    let step = all.len().div_ceil(most).max(1);
    all.into_iter().step_by(step).collect()
}

/// A camera, brought into line.
#[derive(Clone, Debug)]
pub(super) struct Aligned {
    pub camera: Camera,
    /// How bright the photograph is, as a multiple of the field.
    pub gain: f64,
    /// Surface points that it sees.
    pub points: Vec<DVec3>,
}

/// A linearised residual, over its standard deviation.
struct Residual {
    value: f64,
    slopes: SVector<f64, 7>,
}

/// Moves `camera` to where the field explains the photograph best; `given` is where the files say that it stands, and
/// `cell` how many pixels a cell of the field is wide.
pub(super) fn align(
    camera: &Camera,
    given: &Camera,
    marks: &Marks,
    photo: &SmoothPhotograph,
    field: &GridField,
    cell: f64,
) -> Aligned {
    let largest = (LARGEST_OUTLINE_DEVIATION * cell).max(0.5);
    let mut now = Aligned { camera: camera.clone(), gain: 1.0, points: Vec::new() };
    let mut best: Option<(f64, Aligned)> = None;
    let mut deviations = None;
    for step in 0..=STEPS {
        let outline = outline_residuals(&now.camera, marks, field);
        let (interior, points) = interior_residuals(&now, marks, photo, field);
        now.points = points;
        let [pixels, colors] = *deviations.get_or_insert_with(|| {
            [deviation(&outline).clamp(LEAST_DEVIATION[0], largest), deviation(&interior).max(LEAST_DEVIATION[1])]
        });
        let mut matrix = SMatrix::<f64, 7, 7>::zeros();
        let mut vector = SVector::<f64, 7>::zeros();
        let mut cost = 0.0;
        for (residuals, deviation) in [(&outline, pixels), (&interior, colors)] {
            for Residual { value, slopes } in residuals {
                let scaled = (value / (OUTLIER * deviation)).powi(2);
                let weight = 1.0 / ((1.0 + scaled) * deviation * deviation * REDUNDANCY);
                cost += (1.0 + scaled).ln() * OUTLIER * OUTLIER / REDUNDANCY;
                matrix += weight * slopes * slopes.transpose();
                vector -= weight * *value * slopes;
            }
        }
        let (expectation, precision) = expectation(&now, given);
        cost += expectation.component_mul(&expectation).dot(&precision);
        matrix += SMatrix::from_diagonal(&precision);
        vector -= precision.component_mul(&expectation);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, now.clone()));
        }
        if step == STEPS {
            break;
        }
        let Some(change) = matrix.cholesky().map(|cholesky| cholesky.solve(&vector)) else { break };
        now = moved(&now, &change);
    }
    best.map_or(now, |(_, aligned)| aligned)
}

/// Where the camera is beside where it is expected, in the parameters of a step, and how sure that is.
fn expectation(now: &Aligned, given: &Camera) -> (SVector<f64, 7>, SVector<f64, 7>) {
    let turn = glam::DQuat::from_mat3(&(now.camera.rotation * given.rotation.transpose())).to_scaled_axis();
    let shift = now.camera.translation - given.translation;
    let far = EXPECTED[1] * given.center().length();
    let deviations = [EXPECTED[0], EXPECTED[0], EXPECTED[0], far, far, far, EXPECTED[2]];
    let values = [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, now.gain.ln()];
    (SVector::from(values), SVector::from(deviations.map(|deviation| deviation.powi(-2))))
}

/// The camera after a step.
fn moved(now: &Aligned, change: &SVector<f64, 7>) -> Aligned {
    let turn = glam::DQuat::from_scaled_axis(DVec3::new(change[0], change[1], change[2]));
    let camera = Camera {
        rotation: DMat3::from_quat(turn) * now.camera.rotation,
        translation: now.camera.translation + DVec3::new(change[3], change[4], change[5]),
        ..now.camera.clone()
    };
    Aligned { camera, gain: now.gain * change[6].exp(), points: Vec::new() }
}

/// The standard deviation, from the median of sizes: outliers do not count.
fn deviation(residuals: &[Residual]) -> f64 {
    let mut sizes: Vec<f64> = residuals.iter().map(|residual| residual.value.abs()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    1.4826 * *sizes.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Pixels between the outline of the field and that of the mask, at pixels along it.
fn outline_residuals(camera: &Camera, marks: &Marks, field: &GridField) -> Vec<Residual> {
    let (grid, focal) = (field.shape_grid(), camera.intrinsics.x_axis.x);
    let residual = |&(u, v, expected): &(u32, u32, f32)| {
        let ray = camera.pixel_ray(u, v);
        let (origin, direction) = (ray.origin.as_vec3(), ray.direction.as_vec3());
        let mut largest = (f32::NEG_INFINITY, 0.0);
        for segment in VoxelTraversal::new(grid, origin, direction, 0.0, f32::INFINITY)? {
            for depth in [segment.enter, 0.5 * (segment.enter + segment.leave)] {
                let value = field.logit_at(origin + depth * direction);
                if value > largest.0 {
                    largest = (value, depth);
                }
            }
        }
        let point = origin + largest.1 * direction;
        let (value, gradient) = field.logit_and_gradient_at(point);
        let steepness = f64::from(gradient.length());
        if steepness < 0.1 {
            return None;
        }
        let scale = focal / (f64::from(largest.1) * steepness);
        // A point of the ray moves against the object as `-(w x R X + u)`.
        let turned = camera.rotation * point.as_dvec3();
        let slope = camera.rotation * gradient.as_dvec3() * -scale;
        let by_turn = turned.cross(slope);
        let slopes = [by_turn.x, by_turn.y, by_turn.z, slope.x, slope.y, slope.z, 0.0];
        Some(Residual { value: scale * f64::from(value) - f64::from(expected), slopes: SVector::from(slopes) })
    };
    marks.outline.iter().filter_map(residual).collect()
}

/// Differences between the photograph and the field at surface points that the camera sees, and those points.
fn interior_residuals(
    now: &Aligned,
    marks: &Marks,
    photo: &SmoothPhotograph,
    field: &GridField,
) -> (Vec<Residual>, Vec<DVec3>) {
    let camera = &now.camera;
    let rays: Vec<_> = marks.interior.iter().map(|&(u, v, _)| camera.pixel_ray(u, v)).collect();
    let (mut residuals, mut points) = (Vec::new(), Vec::new());
    for ((&(u, v, distance), ray), shaded) in marks.interior.iter().zip(&rays).zip(field.shade(&rays)) {
        let Some(shaded) = shaded else { continue };
        points.push(ray.at(f64::from(shaded.depth)));
        // Nearer to the outline, the background is blurred into the object.
        if distance < photo.reach() {
            continue;
        }
        let Some(seen) = photo.sample(DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5)) else { continue };
        let point = ray.at(f64::from(shaded.depth));
        // What is seen edge on slides over the photograph with every error of its depth.
        let facing = f64::from(-Vec3::from(shaded.normal).dot(ray.direction.as_vec3().normalize())).max(0.0);
        let turned = camera.rotation * point;
        let in_front = turned + camera.translation;
        // Derivatives of the pixel by the point in front of the camera.
        let q = camera.intrinsics * in_front;
        let pixel = DVec2::new(q.x, q.y) / q.z;
        let rows = camera.intrinsics.transpose();
        let by_point = [(rows.x_axis - pixel.x * rows.z_axis) / q.z, (rows.y_axis - pixel.y * rows.z_axis) / q.z];
        for channel in 0..3 {
            let (by_x, by_y) = (f64::from(seen.by_x[channel]), f64::from(seen.by_y[channel]));
            let slope = facing * (by_x * by_point[0] + by_y * by_point[1]);
            let by_turn = turned.cross(slope);
            let expected = now.gain * f64::from(shaded.color[channel]);
            residuals.push(Residual {
                value: facing * (f64::from(seen.color[channel]) - expected),
                slopes: SVector::from([by_turn.x, by_turn.y, by_turn.z, slope.x, slope.y, slope.z, -facing * expected]),
            });
        }
    }
    (residuals, points)
}
