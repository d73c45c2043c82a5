//! Mirror images of objects: a picture flipped from left to right shows the mirrored object.

use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::ray::Ray;

/// The axis of object space that changes its sign in the mirror.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MirrorAxis {
    /// Left and right of `x = 0` are exchanged.
    X,
    /// Below and above `y = 0`.
    Y,
    /// Behind and before `z = 0`.
    Z,
}

impl MirrorAxis {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// Its place among the coordinates, from 0.
    pub fn index(self) -> usize {
        self as usize
    }

    /// A point or direction in the mirror.
    pub fn mirrored(self, vector: Vec3) -> Vec3 {
        vector * self.signs().as_vec3()
    }

    /// A ray in the mirror; its depths stay.
    pub fn mirrored_ray(self, ray: &Ray) -> Ray {
        Ray { origin: ray.origin * self.signs(), direction: ray.direction * self.signs() }
    }

    /// The camera that sees the mirrored object in the picture of `camera`, flipped from left to right.
    pub fn mirrored_camera(self, camera: &Camera) -> Camera {
        // In the mirror, the camera's own x would point to the left: it is turned, and pixels are counted from the other side.
        let turned = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        let flipped = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::new(f64::from(camera.width), 0.0, 1.0));
        Camera {
            intrinsics: flipped * camera.intrinsics * turned,
            rotation: turned * camera.rotation * DMat3::from_diagonal(self.signs()),
            translation: turned * camera.translation,
            ..camera.clone()
        }
    }

    fn signs(self) -> DVec3 {
        match self {
            Self::X => DVec3::new(-1.0, 1.0, 1.0),
            Self::Y => DVec3::new(1.0, -1.0, 1.0),
            Self::Z => DVec3::new(1.0, 1.0, -1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mirrored_camera_sees_mirrored_points_where_the_flipped_picture_has_them() {
        let mut camera = Camera::look_at(64, 48, 70.0, DVec3::new(0.7, 0.9, -2.0), DVec3::ZERO, DVec3::Y);
        camera.intrinsics.y_axis.x = 3.0;
        camera.intrinsics.z_axis.x += 5.0;
        for axis in MirrorAxis::ALL {
            let mirrored = axis.mirrored_camera(&camera);
            assert!((mirrored.rotation.determinant() - 1.0).abs() < 1e-12, "a camera, no mirror image of one");
            assert!(mirrored.intrinsics.x_axis.x > 0.0 && mirrored.intrinsics.y_axis.y > 0.0);
            for point in [Vec3::new(0.1, 0.2, -0.3), Vec3::new(-0.4, 0.0, 0.2)] {
                let (place, depth) = camera.project(point.as_dvec3());
                let (found, found_depth) = mirrored.project(axis.mirrored(point).as_dvec3());
                assert!((found.x - (64.0 - place.x)).abs() < 1e-5 && (found.y - place.y).abs() < 1e-5, "{axis:?}");
                assert!((found_depth - depth).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_ray_of_a_pixel_in_the_mirror_is_that_of_the_flipped_pixel() {
        let camera = Camera::look_at(64, 48, 70.0, DVec3::new(0.7, 0.9, -2.0), DVec3::ZERO, DVec3::Y);
        for axis in MirrorAxis::ALL {
            let ray = axis.mirrored_ray(&camera.pixel_ray(10, 20));
            let flipped = axis.mirrored_camera(&camera).pixel_ray(53, 20);
            assert!(ray.origin.distance(flipped.origin) < 1e-9 && ray.direction.distance(flipped.direction) < 1e-9);
        }
    }
}
