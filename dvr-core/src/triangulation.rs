//! Where lines of sight meet: triangulation of one point from several pictures.

use glam::{DMat3, DVec2, DVec3};

use crate::camera::Camera;

/// Rounds of Gauss-Newton at most; two or three are enough from the linear start.
const ROUNDS: usize = 20;

/// A round that moves the point by less than this share of its distance is the last.
const SETTLED: f64 = 1e-10;

/// A picture of a point.
#[derive(Clone, Copy, Debug)]
pub struct Sighting<'a> {
    /// The camera, in the world.
    pub camera: &'a Camera,
    /// Where its picture shows the point, as `(x / z, y / z)` in camera space.
    pub bearing: DVec2,
}

/// A triangulated point.
#[derive(Clone, Copy, Debug)]
pub struct Triangulated {
    /// Where it is, in the world.
    pub point: DVec3,
    /// The covariance of its error where features are off by one pixel in each direction, independently of each other.
    pub covariance: DMat3,
}

/// The point whose reprojection error, the sum of squares in pixels, is smallest (Hartley and Zisserman, section 12.3):
/// Gauss-Newton from the midpoint of the lines of sight, the point to which the sum of squared distances is smallest.
///
/// `None` where the lines are parallel or the point would lie behind a camera.
pub fn triangulate(sightings: &[Sighting]) -> Option<Triangulated> {
    let mut point = midpoint(sightings)?;
    let mut covariance = DMat3::ZERO;
    for _ in 0..ROUNDS {
        let (mut information, mut gradient) = (DMat3::ZERO, DVec3::ZERO);
        for sighting in sightings {
            let camera = sighting.camera;
            let p = camera.rotation * point + camera.translation;
            if p.z <= 0.0 {
                return None;
            }
            let focal = [camera.intrinsics.x_axis.x, camera.intrinsics.y_axis.y];
            for axis in 0..2 {
                let residual = focal[axis] * (p[axis] / p.z - sighting.bearing[axis]);
                // By the point in camera space, then in the world.
                let mut row = DVec3::ZERO;
                row[axis] = focal[axis] / p.z;
                row.z = -focal[axis] * p[axis] / (p.z * p.z);
                let row = camera.rotation.transpose() * row;
                information += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
                gradient += row * residual;
            }
        }
        covariance = inverse(&information)?;
        let step = covariance * gradient;
        point -= step;
        let distance = (point - sightings[0].camera.center()).length();
        if step.length() <= SETTLED * distance {
            break;
        }
    }
    point.is_finite().then_some(Triangulated { point, covariance })
}

/// The point that is nearest to all lines of sight.
fn midpoint(sightings: &[Sighting]) -> Option<DVec3> {
    let (mut matrix, mut vector) = (DMat3::ZERO, DVec3::ZERO);
    for Sighting { camera, bearing } in sightings {
        let direction = (camera.rotation.transpose() * bearing.extend(1.0)).normalize();
        // Projects onto the plane across the line.
        let across = DMat3::IDENTITY
            - DMat3::from_cols(direction * direction.x, direction * direction.y, direction * direction.z);
        matrix += across;
        vector += across * camera.center();
    }
    Some(inverse(&matrix)? * vector)
}

/// `None` for a matrix that is singular in double precision.
fn inverse(matrix: &DMat3) -> Option<DMat3> {
    let size = matrix.x_axis.length() * matrix.y_axis.length() * matrix.z_axis.length();
    let determinant = matrix.determinant();
    (determinant.is_finite() && determinant.abs() > 1e-14 * size).then(|| matrix.inverse())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cameras() -> Vec<Camera> {
        let at = |x: f64| {
            Camera::look_at(640, 480, 700.0, DVec3::new(x, 0.3 * x * x, -4.0), DVec3::new(0.1, 0.2, 0.0), DVec3::Y)
        };
        [-1.0, -0.4, 0.2, 0.9].map(at).to_vec()
    }

    fn sighting(camera: &Camera, point: DVec3) -> Sighting<'_> {
        let p = camera.rotation * point + camera.translation;
        Sighting { camera, bearing: DVec2::new(p.x, p.y) / p.z }
    }

    #[test]
    fn exact_bearings_give_the_exact_point() {
        let (cameras, point) = (cameras(), DVec3::new(0.3, -0.2, 0.5));
        let sightings: Vec<_> = cameras.iter().map(|camera| sighting(camera, point)).collect();
        for count in [2, 4] {
            let found = triangulate(&sightings[..count]).unwrap();
            assert!((found.point - point).length() < 1e-10, "{}", found.point);
        }
    }

    #[test]
    fn the_covariance_says_how_far_a_pixel_moves_the_point() {
        let (cameras, point) = (cameras(), DVec3::new(0.3, -0.2, 0.5));
        let exact: Vec<_> = cameras.iter().map(|camera| sighting(camera, point)).collect();
        let covariance = triangulate(&exact).unwrap().covariance;
        // The sum over all features, each moved by a small part of a pixel in turn.
        let (mut numeric, step) = (DMat3::ZERO, 1e-3);
        for i in 0..exact.len() {
            for axis in 0..2 {
                let mut moved = exact.clone();
                moved[i].bearing[axis] += step / 700.0;
                let d = (triangulate(&moved).unwrap().point - point) / step;
                numeric += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
            }
        }
        let scale = covariance.to_cols_array().iter().fold(0.0f64, |m, x| m.max(x.abs()));
        for (a, b) in covariance.to_cols_array().iter().zip(numeric.to_cols_array()) {
            assert!((a - b).abs() < 1e-3 * scale, "{covariance} {numeric}");
        }
    }

    #[test]
    fn parallel_lines_and_points_behind_a_camera_are_refused() {
        let (cameras, point) = (cameras(), DVec3::new(0.3, -0.2, 0.5));
        let one = sighting(&cameras[0], point);
        assert!(triangulate(&[one, one]).is_none());
        let behind: Vec<_> = cameras.iter().map(|camera| sighting(camera, DVec3::new(0.0, 0.0, -9.0))).collect();
        assert!(triangulate(&behind).is_none());
        assert!(triangulate(&[]).is_none());
    }
}
