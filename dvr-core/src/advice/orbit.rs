//! From which sides an object was photographed.

use std::fmt;

use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

use crate::camera::Camera;
use crate::scene::Scene;

/// Mean square of what the pictures' rows (or columns, where they lie on their side) lean towards the axis, up to which
/// cameras are held upright: about 14 degrees.
const UPRIGHT: f64 = 0.06;

/// The same towards the next direction, from which the axis is the only one.
const ONLY: f64 = 0.1;

/// Where cameras stand around the object's middle.
#[derive(Clone, Debug, PartialEq)]
pub struct Orbit {
    /// The axis that they stand around, upward, in object space: up in the pictures, as far as they agree.
    pub axis: DVec3,
    /// For each view, the side that it looks at.
    pub sides: Vec<Side>,
    /// Azimuth 0 and 90 degrees.
    horizontal: [DVec3; 2],
}

/// A side of the object. As [`Display`](fmt::Display): `azimuth 120, elevation 15 degrees`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Side {
    /// Degrees from the side of the first view, counter-clockwise seen from above, in `[0, 360)`.
    pub azimuth: f64,
    /// Degrees above the object's middle, in `[-90, 90]`.
    pub elevation: f64,
}

impl Orbit {
    /// Of a scene's views.
    pub fn of(scene: &Scene) -> Self {
        let middle = scene.region.bounds.center();
        let cameras: Vec<&Camera> = scene.views.iter().map(|view| &view.camera).collect();
        let directions: Vec<DVec3> =
            cameras.iter().map(|camera| (camera.center() - middle).normalize_or(DVec3::Z)).collect();
        let axis = axis(&cameras, &directions).unwrap_or_else(|| scene.up());
        let first = directions.iter().find_map(|direction| direction.reject_from(axis).try_normalize());
        let first = first.unwrap_or_else(|| axis.any_orthonormal_vector());
        let mut orbit = Self { axis, sides: Vec::new(), horizontal: [first, axis.cross(first)] };
        orbit.sides = directions.iter().map(|&direction| orbit.side(direction)).collect();
        orbit
    }

    /// The side that is seen from a direction out of the object's middle.
    pub fn side(&self, direction: DVec3) -> Side {
        let [x, y] = self.horizontal.map(|axis| direction.dot(axis));
        let azimuth = y.atan2(x).to_degrees().rem_euclid(360.0);
        let height = direction.dot(self.axis) / direction.length().max(f64::MIN_POSITIVE);
        Side {
            azimuth: if azimuth < 360.0 { azimuth } else { 0.0 },
            elevation: height.clamp(-1.0, 1.0).asin().to_degrees(),
        }
    }

    /// The unit vector to a side.
    pub fn direction(&self, side: Side) -> DVec3 {
        let (azimuth, elevation) = (side.azimuth.to_radians(), side.elevation.to_radians());
        let [x, y] = self.horizontal;
        elevation.cos() * (azimuth.cos() * x + azimuth.sin() * y) + elevation.sin() * self.axis
    }
}

/// The axis around which cameras are held upright, or all on their side; `None` where they are not.
fn axis(cameras: &[&Camera], directions: &[DVec3]) -> Option<DVec3> {
    let up: DVec3 = cameras.iter().map(|camera| -camera.rotation.row(1)).sum();
    let (rows, leaning) = most_orthogonal(cameras, 0)?;
    let (columns, leaning_columns) = most_orthogonal(cameras, 1)?;
    if leaning < UPRIGHT && leaning <= 2.0 * leaning_columns {
        return Some(if rows.dot(up) < 0.0 { -rows } else { rows });
    }
    // Pictures do not tell which side of these is up: cameras stand above the object rather than below.
    let height: f64 = directions.iter().map(|direction| direction.dot(columns)).sum();
    (leaning_columns < UPRIGHT).then_some(if height < 0.0 { -columns } else { columns })
}

/// The direction that the rows (0) or columns (1) of pictures are most orthogonal to, and the mean square of what they
/// lean towards it, which counts as much as it can be where the direction is not the only one.
fn most_orthogonal(cameras: &[&Camera], side: usize) -> Option<(DVec3, f64)> {
    let mut spread = Matrix3::<f64>::zeros();
    for camera in cameras {
        let along = nalgebra::Vector3::from(camera.rotation.row(side).to_array());
        spread += along * along.transpose() / cameras.len() as f64;
    }
    if !spread.iter().all(|value| value.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::new(spread);
    let least = eigen.eigenvalues.imin();
    let mut values = [eigen.eigenvalues[0], eigen.eigenvalues[1], eigen.eigenvalues[2]];
    values.sort_by(f64::total_cmp);
    let direction = eigen.eigenvectors.column(least);
    let leaning = if values[1] > ONLY { values[0] } else { 1.0 };
    Some((DVec3::new(direction[0], direction[1], direction[2]).try_normalize()?, leaning))
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "azimuth {:.0}, elevation {:.0} degrees", self.azimuth.round() % 360.0, self.elevation.round() + 0.0)
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use image::RgbImage;

    use super::super::tests::scene_from;
    use super::*;
    use crate::pixels::stored;
    use crate::scene::View;

    /// Cameras at these azimuths and elevations around a leaning axis, each turned around its line of sight.
    fn scene(sides: &[(f64, f64)], axis: DVec3, roll: f64) -> Scene {
        let x = axis.any_orthonormal_vector();
        let y = axis.cross(x);
        let view = |(i, &(azimuth, elevation)): (usize, &(f64, f64))| {
            let (a, e) = (azimuth.to_radians(), elevation.to_radians());
            let eye = 2.0 * (e.cos() * (a.cos() * x + a.sin() * y) + e.sin() * axis);
            let mut camera = Camera::look_at(8, 8, 10.0, eye, DVec3::ZERO, axis);
            let turn = DMat3::from_rotation_z(roll);
            (camera.rotation, camera.translation) = (turn * camera.rotation, turn * camera.translation);
            View::new(format!("{i}"), camera, stored(RgbImage::new(8, 8)), None)
        };
        Scene { views: sides.iter().enumerate().map(view).collect(), ..scene_from(&[]) }
    }

    #[test]
    fn azimuths_count_from_the_first_view_counter_clockwise_from_above() {
        let axis = DVec3::new(0.2, 0.5, 1.0).normalize();
        let sides = [(70.0, 10.0), (100.0, 30.0), (160.0, -20.0), (310.0, 10.0), (10.0, 0.0)];
        let relative = [0.0, 30.0, 90.0, 240.0, 300.0];
        for roll in [0.0, std::f64::consts::FRAC_PI_2, -std::f64::consts::FRAC_PI_2] {
            let orbit = Orbit::of(&scene(&sides, axis, roll));
            assert!(orbit.axis.dot(axis) > 0.9999, "{}", orbit.axis);
            for ((side, &azimuth), (_, elevation)) in orbit.sides.iter().zip(&relative).zip(&sides) {
                let off = (side.azimuth - azimuth + 180.0).rem_euclid(360.0) - 180.0;
                assert!(off.abs() < 1e-6 && (side.elevation - elevation).abs() < 1e-6, "{side:?}");
            }
            let back = orbit.side(orbit.direction(orbit.sides[2]));
            assert!((back.azimuth - 90.0).abs() < 1e-6 && (back.elevation + 20.0).abs() < 1e-6, "{back:?}");
        }
        assert_eq!(Side { azimuth: 359.7, elevation: -0.2 }.to_string(), "azimuth 0, elevation 0 degrees");
    }

    #[test]
    fn cameras_that_look_the_same_way_have_the_axis_of_their_pictures() {
        let axis = DVec3::new(0.0, 1.0, 0.0);
        let orbit = Orbit::of(&scene(&[(0.0, 0.0), (4.0, 1.0), (2.0, -1.0)], axis, 0.0));
        assert!(orbit.axis.dot(axis) > 0.99, "{}", orbit.axis);
    }
}
