//! Cameras in single precision, for inner loops.

use dvr_core::Camera;
use glam::{Mat3, Vec2, Vec3};

/// A pinhole camera: where it stands, from pixels to rays, and from points to pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pinhole {
    /// Where the camera stands.
    pub center: Vec3,
    /// Pixel coordinates (and 1) to a ray direction of unit z-depth.
    pub to_direction: Mat3,
    /// `K R` and `K t`.
    pub projection: Mat3,
    pub offset: Vec3,
}

impl Pinhole {
    /// The same camera in single precision.
    pub fn new(camera: &Camera) -> Self {
        Self {
            center: camera.center().as_vec3(),
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
            to_direction: self.to_direction * Mat3::from_diagonal(Vec3::new(up, up, 1.0)),
            projection: shrink * self.projection,
            offset: shrink * self.offset,
        }
    }

    /// Direction of unit z-depth through a place in the picture.
    pub fn direction_through(&self, pixel: Vec2) -> Vec3 {
        self.to_direction * pixel.extend(1.0)
    }

    /// Pixel coordinates and z-depth of a point.
    pub fn project(&self, point: Vec3) -> (Vec2, f32) {
        let q = self.projection * point + self.offset;
        (Vec2::new(q.x, q.y) / q.z, q.z)
    }

    /// Side of a pixel at the distance of the object's middle, object units.
    pub fn footprint(&self) -> f32 {
        self.to_direction.x_axis.length() * self.center.length()
    }
}
