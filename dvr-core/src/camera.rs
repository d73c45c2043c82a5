//! Pinhole cameras and the similarity between object space and the world of the files.
//!
//! Right-handed; the camera looks along +z, x right, y down (OpenCV, COLMAP). Pixel coordinates start at the top left
//! *corner* of the image: the centre of pixel `(0, 0)` is `(0.5, 0.5)`.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, Vec3};

use crate::error::CameraError;
use crate::ray::Ray;

/// A pinhole camera: intrinsics in pixels, and where it stands.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// `K`: takes camera space to homogeneous pixel coordinates; the last row is `0 0 1`, focal lengths are positive.
    pub intrinsics: DMat3,
    /// Rotation part of `world_to_camera`.
    pub rotation: DMat3,
    /// Translation part of `world_to_camera`.
    pub translation: DVec3,
}

impl Camera {
    /// A camera with square pixels and its principal point in the middle of the image.
    ///
    /// `eye` and `target` are in the space the camera lives in; `up` is only approximate. `focal` is in pixels.
    pub fn look_at(width: u32, height: u32, focal: f64, eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let forward = (target - eye).normalize();
        let side = forward.cross(up);
        let right = if side.length() > 1e-9 { side.normalize() } else { forward.any_orthonormal_vector() };
        let down = forward.cross(right);
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        let intrinsics = DMat3::from_cols(
            DVec3::new(focal, 0.0, 0.0),
            DVec3::new(0.0, focal, 0.0),
            DVec3::new(0.5 * f64::from(width), 0.5 * f64::from(height), 1.0),
        );
        Self { width, height, intrinsics, rotation, translation: -(rotation * eye) }
    }

    /// Splits a projection matrix `P` (3x4, pixels, any scale) into intrinsics and pose by RQ decomposition
    /// (Hartley and Zisserman, section 6.2.4).
    ///
    /// # Errors
    /// When `P` holds a value that is not finite, or its left 3x3 block is singular.
    pub fn from_projection(width: u32, height: u32, left: DMat3, right: DVec3) -> Result<Self, CameraError> {
        if !left.is_finite() || !right.is_finite() {
            return Err(CameraError::NotFinite);
        }
        let volume = left.col(0).length() * left.col(1).length() * left.col(2).length();
        if left.determinant().abs() <= 1e-12 * volume || volume == 0.0 {
            return Err(CameraError::Singular);
        }
        // P and -P are the same camera; the one with det > 0 sees points in front at positive depth.
        let sign = left.determinant().signum();
        let (left, right) = (left * sign, right * sign);
        // RQ by Gram-Schmidt on the rows, last row first.
        let rows = left.transpose();
        let r2 = rows.col(2).normalize();
        let (k22, k12) = (rows.col(2).length(), rows.col(1).dot(r2));
        let v1 = rows.col(1) - k12 * r2;
        let r1 = v1.normalize();
        let (k11, k02, k01) = (v1.length(), rows.col(0).dot(r2), rows.col(0).dot(r1));
        let v0 = rows.col(0) - k02 * r2 - k01 * r1;
        let (k00, r0) = (v0.length(), v0.normalize());
        let intrinsics =
            DMat3::from_cols(DVec3::new(k00, 0.0, 0.0), DVec3::new(k01, k11, 0.0), DVec3::new(k02, k12, k22));
        let translation = intrinsics.inverse() * right;
        let rotation = DMat3::from_cols(r0, r1, r2).transpose();
        Ok(Self { width, height, intrinsics: intrinsics * k22.recip(), rotation, translation })
    }

    /// Where the camera stands.
    pub fn center(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// The unit vector along which the camera looks.
    pub fn forward(&self) -> DVec3 {
        self.rotation.row(2)
    }

    /// `world_to_camera` as a 4x4 matrix.
    pub fn world_to_camera(&self) -> DMat4 {
        DMat4::from_mat3_translation(self.rotation, self.translation)
    }

    /// Pixel coordinates and z-depth of a point; the pixel is meaningless where the depth is not positive.
    pub fn project(&self, point: DVec3) -> (DVec2, f64) {
        let p = self.rotation * point + self.translation;
        let q = self.intrinsics * p;
        (DVec2::new(q.x, q.y) / q.z, p.z)
    }

    /// Whether pixel coordinates fall on the image.
    pub fn sees(&self, pixel: DVec2) -> bool {
        pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < f64::from(self.width) && pixel.y < f64::from(self.height)
    }

    /// The ray through pixel coordinates, with a direction of unit z in camera space: ray depth *is* z-depth.
    pub fn ray(&self, pixel: DVec2) -> Ray {
        let direction = self.intrinsics.inverse() * DVec3::new(pixel.x, pixel.y, 1.0);
        Ray { origin: self.center(), direction: self.rotation.transpose() * direction }
    }

    /// The ray through the centre of pixel `(u, v)`.
    pub fn pixel_ray(&self, u: u32, v: u32) -> Ray {
        self.ray(DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5))
    }

    /// The same camera for an image of another size (box-filtered or cropped to nothing but scale).
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let scale =
            DVec3::new(f64::from(width) / f64::from(self.width), f64::from(height) / f64::from(self.height), 1.0);
        Self { width, height, intrinsics: DMat3::from_diagonal(scale) * self.intrinsics, ..self.clone() }
    }

    /// The same camera, standing in the object space of `object_to_world` instead of the world.
    ///
    /// z-depths in the result are in object units, i.e. divided by the similarity's scale.
    pub fn into_object_space(&self, object_to_world: &Similarity) -> Self {
        let rotation = self.rotation * DMat3::from_quat(object_to_world.rotation);
        let translation = (self.rotation * object_to_world.translation + self.translation) / object_to_world.scale;
        Self { rotation, translation, ..self.clone() }
    }

    /// The inverse of [`Camera::into_object_space`].
    pub fn into_world(&self, object_to_world: &Similarity) -> Self {
        self.into_object_space(&object_to_world.inverse())
    }
}

/// A similarity `x -> scale * R x + t`; as `object_to_world` it is the `scale_mat` of the DVR files.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Similarity {
    /// Uniform scale, positive: world units per object unit.
    pub scale: f64,
    /// Rotation.
    pub rotation: DQuat,
    /// Translation, applied last, in world units.
    pub translation: DVec3,
}

impl Default for Similarity {
    fn default() -> Self {
        Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO }
    }
}

impl Similarity {
    /// Reads a 4x4 matrix.
    ///
    /// # Errors
    /// When the matrix is not finite, is singular, mirrors, shears, or scales its axes by more than 0.1 % differently.
    pub fn from_matrix(matrix: &DMat4) -> Result<Self, CameraError> {
        let linear = DMat3::from_mat4(*matrix);
        let scale = linear.determinant().cbrt();
        if !matrix.is_finite() || scale.is_nan() || scale <= 0.0 {
            return Err(CameraError::NoScale { scale });
        }
        let rotation = linear * scale.recip();
        let defect = rotation * rotation.transpose() - DMat3::IDENTITY;
        if defect.to_cols_array().iter().any(|x| x.abs() > 2e-3) {
            return Err(CameraError::Stretched);
        }
        let translation = matrix.w_axis.truncate();
        Ok(Self { scale, rotation: DQuat::from_mat3(&rotation).normalize(), translation })
    }

    /// As a 4x4 matrix.
    pub fn to_matrix(&self) -> DMat4 {
        DMat4::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation, self.translation)
    }

    /// Takes a point from object space to the world.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// [`Similarity::transform_point`] for single precision, computed in double.
    pub fn transform_point_f32(&self, point: Vec3) -> Vec3 {
        self.transform_point(point.as_dvec3()).as_vec3()
    }

    /// Takes a direction (a normal, say) to the world, keeping its length.
    pub fn transform_direction(&self, direction: Vec3) -> Vec3 {
        (self.rotation * direction.as_dvec3()).as_vec3()
    }

    /// What `first` and then `self` do.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            scale: self.scale * first.scale,
            rotation: (self.rotation * first.rotation).normalize(),
            translation: self.transform_point(first.translation),
        }
    }

    /// The way back.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { scale: self.scale.recip(), rotation, translation: -(rotation * self.translation) / self.scale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Camera {
        let mut camera = Camera::look_at(80, 60, 70.0, DVec3::new(1.0, 0.4, -1.2), DVec3::new(0.1, 0.0, 0.0), DVec3::Y);
        camera.intrinsics.y_axis.x = 0.7; // skew
        camera
    }

    #[test]
    fn a_ray_comes_back_to_its_pixel_and_its_depth_is_z() {
        let pixel = DVec2::new(12.25, 40.5);
        let (back, z) = camera().project(camera().ray(pixel).at(1.7));
        assert!((back - pixel).length() < 1e-10 && (z - 1.7).abs() < 1e-12);
    }

    #[test]
    fn the_world_above_the_target_is_in_the_upper_half_of_the_image() {
        let camera = Camera::look_at(10, 10, 10.0, DVec3::new(0.0, 0.0, -2.0), DVec3::ZERO, DVec3::Y);
        assert!(camera.project(DVec3::Y * 0.1).0.y < 5.0);
        assert!(camera.rotation.determinant() > 0.999);
    }

    #[test]
    fn a_projection_matrix_splits_into_the_camera_that_made_it() {
        let camera = camera();
        for factor in [3.0, -0.2] {
            let left = camera.intrinsics * camera.rotation * factor;
            let right = camera.intrinsics * camera.translation * factor;
            let back = Camera::from_projection(80, 60, left, right).unwrap();
            assert!((back.intrinsics - camera.intrinsics).to_cols_array().iter().all(|x| x.abs() < 1e-9));
            assert!((back.center() - camera.center()).length() < 1e-10);
            assert!((back.forward() - camera.forward()).length() < 1e-10);
        }
    }

    #[test]
    fn a_singular_or_infinite_projection_is_refused() {
        assert!(Camera::from_projection(8, 8, DMat3::ZERO, DVec3::ONE).is_err());
        assert!(Camera::from_projection(8, 8, DMat3::IDENTITY, DVec3::splat(f64::NAN)).is_err());
    }

    #[test]
    fn object_space_sees_the_same_picture() {
        let similarity = Similarity {
            scale: 37.0,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.9),
            translation: DVec3::new(5.0, -7.0, 110.0),
        };
        let (camera, point) = (camera(), DVec3::new(0.2, -0.1, 0.3));
        let world = similarity.transform_point(point);
        let (a, z_world) = camera.project(world);
        let (b, z_object) = camera.into_object_space(&similarity).project(point);
        assert!((a - b).length() < 1e-9 && (z_world - similarity.scale * z_object).abs() < 1e-9);
        let back = camera.into_object_space(&similarity).into_world(&similarity);
        assert!((back.translation - camera.translation).length() < 1e-9);
        assert_eq!(Similarity::from_matrix(&similarity.to_matrix()).unwrap().scale.round(), 37.0);
    }
}
