//! The watertight test of a ray against a triangle (Woop, Benthin and Wald 2013).

use glam::{DVec3, Vec3};

use crate::ray::Ray;

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayHit {
    /// Index of the face.
    pub face: u32,
    /// Ray depth, in multiples of the length of the ray's direction.
    pub ray_depth: f64,
    /// Weights of the face's corners at the point that was hit; they sum to one.
    pub barycentric: [f64; 3],
    /// Whether the ray met the side from which the face winds counter-clockwise, the outside.
    pub front: bool,
}

/// A shear that turns the ray into the z axis (Woop et al., section 3.1).
pub(super) struct Shear {
    origin: DVec3,
    /// The direction's largest component, and the others in an order that keeps the winding.
    axes: [usize; 3],
    shear: DVec3,
}

impl Shear {
    /// `None` for a ray without a direction.
    pub(super) fn new(ray: &Ray) -> Option<Self> {
        let z = ray.direction.abs().max_position();
        let largest = ray.direction[z];
        if largest == 0.0 || !ray.direction.is_finite() || !ray.origin.is_finite() {
            return None;
        }
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if largest < 0.0 {
            (x, y) = (y, x);
        }
        let shear = DVec3::new(ray.direction[x] / largest, ray.direction[y] / largest, largest.recip());
        Some(Self { origin: ray.origin, axes: [x, y, z], shear })
    }

    /// Where the ray meets a face, from either side.
    pub(super) fn intersect(&self, corners: &[Vec3; 3], face: u32) -> Option<RayHit> {
        let [x, y, z] = self.axes;
        let relative = corners.map(|corner| corner.as_dvec3() - self.origin);
        let [a, b, c] = relative.map(|p| (p[x] - self.shear.x * p[z], p[y] - self.shear.y * p[z]));
        // Scaled barycentrics: the edge that a neighbour shares gives the same number there, with the sign turned.
        let u = c.0 * b.1 - c.1 * b.0;
        let v = a.0 * c.1 - a.1 * c.0;
        let w = b.0 * a.1 - b.1 * a.0;
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        let barycentric = [u, v, w].map(|value| value / determinant);
        let depths = relative.map(|p| self.shear.z * p[z]);
        let ray_depth = barycentric.iter().zip(depths).map(|(weight, depth)| weight * depth).sum();
        Some(RayHit { face, ray_depth, barycentric, front: determinant > 0.0 })
    }
}
