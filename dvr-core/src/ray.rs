//! Rays, and where they pass through the padded unit cube.

use glam::DVec3;

/// The half-line `r(d) = origin + d * direction`, `d >= 0`.
///
/// The direction need not be normalised: `d` is the *ray depth*, in multiples of its length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the ray starts (`r0` in the paper).
    pub origin: DVec3,
    /// Where it points (`w` in the paper), of any length but zero.
    pub direction: DVec3,
}

impl Ray {
    /// The point at ray depth `d`.
    pub fn at(&self, ray_depth: f64) -> DVec3 {
        self.origin + ray_depth * self.direction
    }
}

/// The cube `[-0.5, 0.5]^3` around the origin, grown by half of `padding` on every side.
///
/// Objects live in the unpadded cube; the padding lets a surface that touches a face be crossed from outside.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct UnitCube {
    /// Total growth of the edge length; the faces lie at `+-(0.5 + padding / 2)`.
    pub padding: f64,
}

impl Default for UnitCube {
    /// The padding of DVR's reference code, 0.1: faces at `+-0.55`.
    fn default() -> Self {
        Self { padding: 0.1 }
    }
}

impl UnitCube {
    /// Half the edge length, 0.55 by default.
    pub fn half_extent(&self) -> f64 {
        0.5 + 0.5 * self.padding
    }

    /// Whether `point` lies in the cube, faces included.
    pub fn contains(&self, point: DVec3) -> bool {
        point.abs().max_element() <= self.half_extent()
    }

    /// Ray depths `(entry, exit)` between which the ray is inside the cube, or `None` where it never is.
    ///
    /// The slab test (Kay and Kajiya 1986). It holds for any ray: one that starts inside enters at depth 0, a cube
    /// behind the origin is missed, a ray parallel to a slab counts as inside it while its origin is (faces included),
    /// and rays through edges and corners are hits. A grazing touch gives `entry == exit`.
    pub fn intersect(&self, ray: &Ray) -> Option<(f64, f64)> {
        let half = self.half_extent();
        let (mut entry, mut exit) = (0.0f64, f64::INFINITY);
        for axis in 0..3 {
            let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
            if direction == 0.0 {
                // 0 * inf would be NaN below: decide parallel rays by their origin alone.
                if origin.abs() > half {
                    return None;
                }
                continue;
            }
            let (a, b) = ((-half - origin) / direction, (half - origin) / direction);
            entry = entry.max(a.min(b));
            exit = exit.min(a.max(b));
        }
        (entry <= exit && exit.is_finite()).then_some((entry, exit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: direction.into() }
    }

    #[test]
    fn a_ray_from_outside_enters_and_leaves() {
        let hit = UnitCube::default().intersect(&ray([0.0, 0.0, -2.0], [0.0, 0.0, 2.0])).unwrap();
        assert!((hit.0 - 0.725).abs() < 1e-12 && (hit.1 - 1.275).abs() < 1e-12);
    }

    #[test]
    fn a_ray_from_inside_enters_at_its_origin() {
        assert_eq!(UnitCube { padding: 0.0 }.intersect(&ray([0.0; 3], [0.0, 1.0, 0.0])), Some((0.0, 0.5)));
    }

    #[test]
    fn a_cube_behind_the_origin_is_missed() {
        assert_eq!(UnitCube::default().intersect(&ray([0.0, 0.0, 2.0], [0.0, 0.0, 1.0])), None);
    }

    #[test]
    fn a_ray_in_a_face_plane_is_inside_and_one_beside_it_is_not() {
        let cube = UnitCube { padding: 0.0 };
        assert_eq!(cube.intersect(&ray([0.5, 0.0, -1.0], [0.0, 0.0, 1.0])), Some((0.5, 1.5)));
        assert_eq!(cube.intersect(&ray([0.5 + 1e-9, 0.0, -1.0], [0.0, 0.0, 1.0])), None);
    }

    #[test]
    fn a_ray_through_a_corner_or_an_edge_hits() {
        let cube = UnitCube { padding: 0.0 };
        assert!(cube.intersect(&ray([-1.0; 3], [1.0; 3])).is_some());
        let (entry, exit) = cube.intersect(&ray([-1.0, 0.0, 0.0], [1.0, 1.0, 0.0])).unwrap();
        assert_eq!((entry, exit), (0.5, 0.5), "touches the edge x = -0.5, y = 0.5");
    }

    #[test]
    fn a_ray_without_direction_or_with_nan_never_hits() {
        let cube = UnitCube::default();
        assert_eq!(cube.intersect(&ray([0.0; 3], [0.0; 3])), None);
        assert!(cube.intersect(&ray([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0])).is_none_or(|(a, b)| a <= b));
    }
}
