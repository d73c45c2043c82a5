//! Normals of points that have none.

use std::num::NonZero;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;

/// Points that a normal is estimated from, itself included.
const NEIGHBOURS: NonZero<usize> = NonZero::new(16).unwrap();

/// For each point the direction in which its neighbourhood is thinnest, of either sign (Hoppe et al. 1992, section 3.2).
pub(super) fn estimated_normals(points: &[Vec3]) -> Vec<Vec3> {
    let positions: Vec<[f64; 3]> = points.iter().map(|point| point.as_dvec3().to_array()).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions) else { return vec![Vec3::Z; points.len()] };
    let normal = |position: &[f64; 3]| {
        let near = tree.query(position).nearest_n::<SquaredEuclidean<f64>>(NEIGHBOURS).execute();
        let around: Vec<Vector3<f64>> =
            near.iter().map(|found| Vector3::from(positions[found.item as usize])).collect();
        let middle = around.iter().sum::<Vector3<f64>>() / around.len().max(1) as f64;
        let spread: Matrix3<f64> = around.iter().map(|point| (point - middle) * (point - middle).transpose()).sum();
        let eigen = SymmetricEigen::new(spread);
        let axis = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        Vec3::new(axis.x as f32, axis.y as f32, axis.z as f32).normalize_or(Vec3::Z)
    };
    positions.par_iter().map(normal).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;
    use crate::sampling::sample_surface;

    #[test]
    fn normals_of_a_ball_point_to_its_centre_or_away_and_few_points_have_one_too() {
        let points = sample_surface(&shapes::icosphere(5, 2.0), 5000, 1).points;
        let off: f32 = points.iter().zip(estimated_normals(&points)).map(|(p, n)| 1.0 - (p.dot(n) / 2.0).abs()).sum();
        assert!(off / 5000.0 < 0.01, "{}", off / 5000.0);
        assert!(estimated_normals(&[Vec3::ONE, Vec3::ZERO]).iter().all(|normal| normal.is_normalized()));
        assert!(estimated_normals(&[]).is_empty());
    }
}
