//! The quadratic error function: the point nearest to a set of tangent planes.

use glam::{DMat3, DVec3};

/// Weight of the distance to the mass point, as a share of the number of planes.
///
/// It is to the eigenvalues of `A^T A` as a soft threshold: with [`ROUNDS`], a bend of 16 degrees between two halves of
/// the normals (a share of 0.02) is followed to 99 %, one of 5 degrees (curvature, or noise) to 50 %, one of 1 degree
/// to 3 %.
const DAMPING: f64 = 0.01;

/// Rounds of the iterated Tikhonov regularisation. One would pull corners towards the mass point; each further round
/// takes that bias to the next power.
const ROUNDS: usize = 4;

/// `E(x) = sum_i (n_i . (x - p_i))^2` over points `p_i` of a surface and unit normals `n_i` there (Ju et al. 2002,
/// section 2.3): zero where the tangent planes meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct QuadraticError {
    /// `A^T A`, where the rows of `A` are the normals.
    products: DMat3,
    /// `A^T b` with `b_i = n_i . p_i`.
    offsets: DVec3,
    point_sum: DVec3,
    planes: u32,
}

impl QuadraticError {
    /// No planes.
    pub fn new() -> Self {
        Self { products: DMat3::ZERO, offsets: DVec3::ZERO, point_sum: DVec3::ZERO, planes: 0 }
    }

    /// Adds a tangent plane.
    pub fn add(&mut self, point: DVec3, normal: DVec3) {
        self.products += DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
        self.offsets += normal * normal.dot(point);
        self.point_sum += point;
        self.planes += 1;
    }

    /// The mean of the points.
    ///
    /// There must be at least one.
    pub fn mass_point(&self) -> DVec3 {
        self.point_sum / f64::from(self.planes)
    }

    /// The point of least error in a box that holds all points; where the planes leave it open, or all but open, the
    /// one nearest to the mass point (Lindstrom 2000, section 4).
    ///
    /// A coordinate that would leave the box is held at its bound while the others are sought anew, so that a crease
    /// which passes through a corner of the box is met there. Moving the free minimiser into the box could leave the
    /// crease.
    pub fn minimiser_within(&self, low: DVec3, high: DVec3) -> DVec3 {
        let mut start = self.mass_point();
        let mut free = DVec3::ONE;
        loop {
            let found = self.minimiser_along(start, free);
            let within = found.clamp(low, high);
            let (farthest, excess) = ((found - within).abs().max_position(), (found - within).abs().max_element());
            if excess == 0.0 {
                return found;
            }
            free[farthest] = 0.0;
            start[farthest] = within[farthest];
        }
    }

    /// The damped minimiser from `start` on, along the axes where `free` is 1; the other coordinates keep their values.
    fn minimiser_along(&self, start: DVec3, free: DVec3) -> DVec3 {
        let damping = DMat3::from_diagonal(DVec3::splat(DAMPING * f64::from(self.planes)));
        let mask = DMat3::from_diagonal(free);
        let held = DMat3::from_diagonal(1.0 - free);
        let inverse = (mask * (self.products + damping) * mask + held).inverse();
        (0..ROUNDS).fold(start, |x, _| x + inverse * (free * (self.offsets - self.products * x)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn minimiser(planes: &[(DVec3, DVec3)]) -> DVec3 {
        let mut error = QuadraticError::new();
        planes.iter().for_each(|&(point, normal)| error.add(point, normal.normalize()));
        error.minimiser_within(DVec3::splat(-10.0), DVec3::splat(10.0))
    }

    #[test]
    fn three_planes_meet_in_their_corner() {
        let corner = DVec3::new(0.3, 0.8, 0.1);
        let normals = [DVec3::new(1.0, 0.2, 0.1), DVec3::new(-0.3, 1.0, 0.2), DVec3::new(0.1, -0.2, 1.0)];
        let planes = normals.map(|normal| (corner + normal.normalize().any_orthonormal_vector(), normal));
        assert!(minimiser(&planes).distance(corner) < 1e-4);
    }

    #[test]
    fn two_planes_leave_the_place_along_their_crease_to_the_mean() {
        let found = minimiser(&[
            (DVec3::new(0.1, 0.0, 0.2), DVec3::Y),
            (DVec3::new(0.9, 0.0, 0.4), DVec3::Y),
            (DVec3::new(0.0, 0.7, 0.9), DVec3::X),
        ]);
        assert!(found.distance(DVec3::new(0.0, 0.0, 0.5)) < 1e-4, "{found}");
    }

    #[test]
    fn planes_that_hardly_bend_keep_the_mean_of_their_points() {
        // Two that meet 5 units away, at half a degree.
        let bend = 0.5f64.to_radians();
        let shift = DVec3::new(5.0 * bend, 0.0, 0.0);
        let found = minimiser(&[(DVec3::Z, DVec3::X), (shift - DVec3::Z, DVec3::new(1.0, bend, 0.0))]);
        assert!(found.distance(0.5 * shift) < 0.05, "{found}");
    }

    #[test]
    fn a_crease_that_leaves_the_box_is_met_where_it_enters() {
        // Along (1, 0, 1) through (0.9, 0.2, 0): nearest to the mass point outside, at x > 1, but for a piece in the
        // box.
        let (on_crease, along) = (DVec3::new(0.9, 0.2, 0.0), DVec3::new(1.0, 0.0, 1.0));
        let mut error = QuadraticError::new();
        for normal in [DVec3::Y, DVec3::new(1.0, 0.0, -1.0).normalize()] {
            error.add(on_crease + along * 0.3 + normal.cross(along), normal);
            error.add(on_crease + along * 0.4 + normal.cross(along), normal);
        }
        let found = error.minimiser_within(DVec3::ZERO, DVec3::ONE);
        assert!(found.distance(DVec3::new(1.0, 0.2, 0.1)) < 1e-3, "{found}");
    }
}
