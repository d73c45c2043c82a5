//! Silhouettes of triangles with soft edges, against masks (Liu et al. 2019, Soft Rasterizer).

use burn::tensor::Tensor;
use dvr_core::{Camera, Mask};
use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;

use super::surrogate::with_gradient;

/// A triangle reaches this far beyond its edges, in units of `sharpness`: there it covers a pixel by 1e-4.
const REACH: f64 = 9.2;

/// How the object looks from one side.
#[derive(Clone, Debug)]
pub struct Silhouette {
    /// In object space.
    pub camera: Camera,
    /// Which pixels show it.
    pub mask: Mask,
}

/// One minus the intersection over union of silhouettes of a mesh and masks, a mean over all views, `[1]` (the paper's equation
/// 5), and the mean intersection over union itself.
///
/// Vertices are `[b, v, 3]`, in object space; each object has its views. `sharpness` is the paper's sigma, in squares of half
/// a picture's width.
pub(crate) fn silhouette_loss(
    vertices: &Tensor<3>,
    faces: &[[u32; 3]],
    views: &[Vec<Silhouette>],
    sharpness: f64,
) -> (Tensor<1>, f64) {
    let [_, n, _] = vertices.dims();
    let data: Vec<f32> = vertices.clone().inner().into_data().iter::<f32>().collect();
    let count = views.iter().map(Vec::len).sum::<usize>().max(1) as f64;
    let of_each: Vec<(f64, Vec<DVec3>)> = data
        .par_chunks(3 * n)
        .zip(views)
        .map(|(flat, views)| {
            let vertices: Vec<DVec3> = flat.chunks(3).map(|v| glam::Vec3::from_slice(v).as_dvec3()).collect();
            let mut gradient = vec![DVec3::ZERO; n];
            let edges = Edges { sharpness, reach: REACH };
            let costs = views.iter().map(|view| cost(&vertices, faces, view, edges, &mut gradient));
            (costs.sum::<f64>() / count, gradient)
        })
        .collect();
    let value: f64 = of_each.iter().map(|(cost, _)| cost).sum();
    let gradient = of_each.iter().flat_map(|(_, of_object)| of_object).flat_map(|g| (*g / count).as_vec3().to_array());
    (with_gradient(value, vertices.clone(), gradient.collect()), 1.0 - value)
}

/// A vertex in the picture.
#[derive(Clone, Copy)]
struct Projected {
    /// In units of half the picture's width.
    place: DVec2,
    /// Derivative of the place by the vertex, a row each.
    rows: [DVec3; 2],
    is_before: bool,
}

/// A triangle's cover of a pixel.
struct Cover {
    pixel: usize,
    face: usize,
    /// The sigmoid of the signed squared distance (equation 1).
    share: f64,
    /// Derivative of the signed squared distance by the triangle's corners.
    corners: [DVec2; 3],
}

/// How triangles end.
#[derive(Clone, Copy)]
struct Edges {
    /// The paper's sigma, in squares of half a picture's width.
    sharpness: f64,
    /// Beyond the edges by the root of so many `sharpness` a triangle covers nothing.
    reach: f64,
}

/// The cost of one view; adds its gradient.
///
/// A pixel is covered by `1 - prod (1 - D_j)` (equation 4, for silhouettes), with the sigmoids `D_j`. By the squared distance in
/// `D_j` that changes by `(1 - cover) D_j / sharpness`: no division by what may be zero.
fn cost(vertices: &[DVec3], faces: &[[u32; 3]], view: &Silhouette, edges: Edges, gradient: &mut [DVec3]) -> f64 {
    let Silhouette { camera, mask } = view;
    let Edges { sharpness, reach } = edges;
    let half = 0.5 * f64::from(camera.width);
    let projected: Vec<Projected> = vertices.iter().map(|vertex| project(camera, *vertex, half)).collect();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut open = vec![1.0; width * height];
    let mut covers = Vec::new();
    for (face, corners) in faces.iter().enumerate() {
        let corners = corners.map(|corner| projected[corner as usize]);
        if corners.iter().any(|corner| !corner.is_before) {
            continue;
        }
        let corners = corners.map(|corner| corner.place);
        let margin = (reach * sharpness).sqrt();
        let low = (corners[0].min(corners[1]).min(corners[2]) - margin) * half - 0.5;
        let high = (corners[0].max(corners[1]).max(corners[2]) + margin) * half - 0.5;
        let range = |low: f64, high: f64, size: usize| {
            low.ceil().clamp(0.0, size as f64) as usize..(high.floor() + 1.0).clamp(0.0, size as f64) as usize
        };
        for v in range(low.y, high.y, height) {
            for u in range(low.x, high.x, width) {
                let place = DVec2::new(u as f64 + 0.5, v as f64 + 0.5) / half;
                let (distance, by_corners) = signed_square(place, corners);
                let exponent = distance / sharpness;
                if exponent < -reach {
                    continue;
                }
                let share = 1.0 / (1.0 + (-exponent).exp());
                open[v * width + u] *= 1.0 - share;
                covers.push(Cover { pixel: v * width + u, face, share, corners: by_corners });
            }
        }
    }
    let is_object = |pixel: usize| mask.is_object((pixel % width) as u32, (pixel / width) as u32);
    let (mut both, mut either) = (0.0, 0.0);
    for (pixel, open) in open.iter().enumerate() {
        let (cover, object) = (1.0 - open, f64::from(u8::from(is_object(pixel))));
        both += cover * object;
        either += cover + object - cover * object;
    }
    if either == 0.0 {
        return 0.0;
    }
    for Cover { pixel, face, share, corners } in covers {
        // Of 1 - both / either by the cover of this pixel.
        let by_cover = if is_object(pixel) { -1.0 / either } else { both / (either * either) };
        let by_distance = by_cover * open[pixel] * share / sharpness;
        for (corner, by_corner) in faces[face].iter().zip(corners) {
            let [x, y] = projected[*corner as usize].rows;
            gradient[*corner as usize] += by_distance * (by_corner.x * x + by_corner.y * y);
        }
    }
    1.0 - both / either
}

fn project(camera: &Camera, vertex: DVec3, half: f64) -> Projected {
    let (pixel, depth) = camera.project(vertex);
    // The projection is q.xy / q.z with q = K (R v + t): its derivative follows from that of q.
    let by_vertex = camera.intrinsics * camera.rotation;
    let row = |row: usize, at: f64| (by_vertex.row(row) - at * by_vertex.row(2)) / (depth * half);
    Projected { place: pixel / half, rows: [row(0, pixel.x), row(1, pixel.y)], is_before: depth > 1e-6 }
}

/// The squared distance of a point to the nearest edge of a triangle, positive inside of it, and its derivative by the
/// corners.
fn signed_square(point: DVec2, corners: [DVec2; 3]) -> (f64, [DVec2; 3]) {
    let side = |i: usize| DMat2::from_cols(corners[(i + 1) % 3] - corners[i], point - corners[i]).determinant();
    let sides = [side(0), side(1), side(2)];
    let is_inside = sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0);
    let sign = if is_inside { 1.0 } else { -1.0 };
    let (mut least, mut by_corners) = (f64::INFINITY, [DVec2::ZERO; 3]);
    for i in 0..3 {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        let edge = b - a;
        let along = ((point - a).dot(edge) / edge.length_squared().max(1e-18)).clamp(0.0, 1.0);
        let to_point = point - (a + along * edge);
        if to_point.length_squared() < least {
            least = to_point.length_squared();
            by_corners = [DVec2::ZERO; 3];
            // The nearest place on the edge is the best one: its share does not count.
            by_corners[i] = -2.0 * sign * (1.0 - along) * to_point;
            by_corners[(i + 1) % 3] = -2.0 * sign * along * to_point;
        }
    }
    (sign * least, by_corners)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};
    use dvr_core::mesh::shapes::icosphere;
    use image::{GrayImage, Luma};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const SHARPNESS: f64 = 1e-3;

    fn disc(size: u32, radius: f64) -> Mask {
        let is_object = |u, v| (DVec2::new(u, v) + 0.5).distance(DVec2::splat(f64::from(size) / 2.0)) < radius;
        Mask::from(GrayImage::from_fn(size, size, |u, v| Luma([if is_object(u.into(), v.into()) { 255 } else { 0 }])))
    }

    fn view(eye: DVec3, mask: Mask) -> Silhouette {
        Silhouette { camera: Camera::look_at(32, 32, 40.0, eye, DVec3::ZERO, DVec3::Y), mask }
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        // What comes within reach of a pixel, or leaves it, is a step: here all of it stays within.
        let edges = Edges { sharpness: SHARPNESS, reach: f64::INFINITY };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let ball = icosphere(1, 0.3);
        let mut jitter = || DVec3::from_array(std::array::from_fn(|_| rng.random_range(-0.03..0.03)));
        let mut vertices: Vec<DVec3> = ball.vertices.iter().map(|v| v.as_dvec3() + jitter()).collect();
        let view = view(DVec3::new(0.4, 0.3, -2.0), disc(32, 9.0));
        let mut gradient = vec![DVec3::ZERO; vertices.len()];
        cost(&vertices, &ball.faces, &view, edges, &mut gradient);
        let largest = gradient.iter().map(|g| g.length()).fold(0.0, f64::max);
        assert!(largest > 1e-2);
        let mut nothing = gradient.clone();
        for vertex in 0..vertices.len() {
            for axis in 0..3 {
                let here = vertices[vertex][axis];
                let mut at = |shift: f64| {
                    vertices[vertex][axis] = here + shift;
                    cost(&vertices, &ball.faces, &view, edges, &mut nothing)
                };
                let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                vertices[vertex][axis] = here;
                let found = gradient[vertex][axis];
                assert!((difference - found).abs() < 1e-6, "{vertex} {axis}: {found}, by differences {difference}");
            }
        }
    }

    #[test]
    fn squared_distances_and_their_derivatives_are_right_on_all_sides() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for _ in 0..300 {
            let mut place = || DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
            let (point, mut corners) = (place(), [place(), place(), place()]);
            let (_, by_corners) = signed_square(point, corners);
            for corner in 0..3 {
                for axis in 0..2 {
                    let here = corners[corner][axis];
                    let mut at = |shift: f64| {
                        corners[corner][axis] = here + shift;
                        signed_square(point, corners).0
                    };
                    let difference = (at(1e-6) - at(-1e-6)) / 2e-6;
                    corners[corner][axis] = here;
                    assert!((difference - by_corners[corner][axis]).abs() < 1e-6, "{point} {corners:?}");
                }
            }
        }
        let triangle = [DVec2::ZERO, DVec2::X, DVec2::Y];
        assert!((signed_square(DVec2::new(0.1, 0.5), triangle).0 - 0.01).abs() < 1e-12);
        assert!((signed_square(DVec2::new(-0.2, -0.1), triangle).0 + 0.05).abs() < 1e-12);
    }

    #[test]
    fn a_ball_takes_the_size_of_its_masks() {
        let device = Device::flex().autodiff();
        let ball = icosphere(2, 0.15);
        let flat: Vec<f32> = ball.vertices.iter().flat_map(|v| v.to_array()).collect();
        let mut vertices = Tensor::<3>::from_data(TensorData::new(flat, [1, ball.vertices.len(), 3]), &device);
        // A ball of .3 at a distance of 2: 40 * .3 / sqrt(2^2 - .3^2) pixels.
        let views: Vec<_> = [DVec3::X, DVec3::NEG_Z, DVec3::new(0.7, 0.2, 0.68)]
            .map(|eye| view(eye.normalize() * 2.0, disc(32, 6.07)))
            .to_vec();
        let mut iou = 0.0;
        for _ in 0..120 {
            vertices = vertices.require_grad();
            let (loss, now) = silhouette_loss(&vertices, &ball.faces, std::slice::from_ref(&views), SHARPNESS);
            iou = now;
            let gradient = vertices.grad(&loss.backward()).unwrap();
            vertices = Tensor::from_inner(vertices.inner() - gradient * 0.3);
        }
        assert!(iou > 0.9, "{iou}");
    }
}
