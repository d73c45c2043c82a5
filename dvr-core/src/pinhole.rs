//! Cameras in single precision, for inner loops.

use glam::{Mat3, Vec2, Vec3};

use crate::camera::Camera;

/// A pinhole camera in single precision: where it stands, from pixels to rays, and from points to pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Where the camera stands.
    pub center: Vec3,
    /// Focal length in x, pixels.
    pub focal: f32,
    /// Pixel coordinates (and 1) to a ray direction of unit z-depth.
    pub to_direction: Mat3,
    /// `K R`: points to homogeneous pixel coordinates, once `offset` is added.
    pub projection: Mat3,
    /// `K t`.
    pub offset: Vec3,
}

impl Pinhole {
    /// The same camera in single precision.
    pub fn new(camera: &Camera) -> Self {
        Self {
            center: camera.center().as_vec3(),
            focal: camera.intrinsics.x_axis.x as f32,
            to_direction: (camera.rotation.transpose() * camera.intrinsics.inverse()).as_mat3(),
            projection: (camera.intrinsics * camera.rotation).as_mat3(),
            offset: (camera.intrinsics * camera.translation).as_vec3(),
        }
    }

    /// The camera of a picture whose pixels are `factor` by `factor` of this one's.
    pub fn shrunk(&self, factor: usize) -> Self {
        let (up, down) = (factor as f32, (factor as f32).recip());
        let shrink = Mat3::from_diagonal(Vec3::new(down, down, 1.0));
        Self {
            center: self.center,
            focal: self.focal * down,
            to_direction: self.to_direction * Mat3::from_diagonal(Vec3::new(up, up, 1.0)),
            projection: shrink * self.projection,
            offset: shrink * self.offset,
        }
    }

    /// Direction of unit z-depth through a place in the picture.
    #[inline]
    pub fn direction_through(&self, pixel: Vec2) -> Vec3 {
        self.to_direction * pixel.extend(1.0)
    }

    /// Pixel coordinates and z-depth of a point; the pixel is meaningless where the depth is not positive.
    #[inline]
    pub fn project(&self, point: Vec3) -> (Vec2, f32) {
        let q = self.projection * point + self.offset;
        (Vec2::new(q.x, q.y) / q.z, q.z)
    }

    /// Side of a pixel at the distance of the origin, in units of the camera's space.
    pub fn footprint(&self) -> f32 {
        self.to_direction.x_axis.length() * self.center.length()
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn it_projects_as_the_camera_does_and_rays_lead_back() {
        let camera = Camera::look_at(60, 50, 70.0, DVec3::new(0.3, 0.4, 2.0), DVec3::ZERO, DVec3::Y);
        let point = Vec3::new(0.1, -0.2, 0.3);
        let (pixel, z_depth) = camera.project(point.as_dvec3());
        for factor in [1, 2] {
            let pinhole = Pinhole::new(&camera).shrunk(factor);
            let (found, depth) = pinhole.project(point);
            assert!(found.distance(pixel.as_vec2() / factor as f32) < 1e-4, "{found}");
            assert!((f64::from(depth) - z_depth).abs() < 1e-5, "{depth}");
            let back = pinhole.center + depth * pinhole.direction_through(found);
            assert!(back.distance(point) < 1e-5, "{back}");
            assert_eq!(pinhole.focal, 70.0 / factor as f32);
            let footprint = camera.center().length() as f32 / pinhole.focal;
            assert!((pinhole.footprint() - footprint).abs() < 1e-6, "{}", pinhole.footprint());
        }
    }
}
