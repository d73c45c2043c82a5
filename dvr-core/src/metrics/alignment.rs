//! Moving a reconstruction onto the truth before the two are compared.
//!
//! Photographs do not determine where an object stands, how it is turned and how large it is: cameras do, and where these
//! are wrong, so is that. A shape is then compared after the similarity is taken out that brings it nearest to the
//! truth.

use glam::{DQuat, DVec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use crate::camera::Similarity;
use crate::error::{Error, Result};
use crate::points::PointCloud;

/// Rounds of nearest points at most.
const ROUNDS: usize = 50;

/// A round that moves points by less than this, in object units, is the last.
const SETTLED: f64 = 1e-7;

/// Damping, as a share of the largest entry on the diagonal: a ball can be turned without coming nearer.
const DAMPING: f64 = 1e-9;

/// Points that are summed up one after another.
const CHUNK: usize = 1024;

/// Matrix and right-hand side of the normal equation.
type Normal = (SMatrix<f64, 7, 7>, SVector<f64, 7>);

/// The similarity that brings points of a surface nearest to the true surface: iterated closest points with the
/// distance to the tangent plane (Chen and Medioni 1992), from where the points lie. It is meant for small
/// displacements. Points that are `reach` or more away from the true surface have no say.
///
/// # Errors
/// When one of the clouds has no points, or the true one no normals.
pub fn align_to_surface(points: &PointCloud, truth: &PointCloud, reach: f64) -> Result<Similarity> {
    let positions: Vec<[f64; 3]> = truth.points.iter().map(|point| point.as_dvec3().to_array()).collect();
    let (Some(normals), Ok(tree)) = (&truth.normals, ImmutableKdTree::<f64, 3>::new_from_slice(&positions)) else {
        return Err(Error::NothingToAlign { problem: "the true surface has no normals or no points" });
    };
    if points.points.is_empty() || positions.is_empty() {
        return Err(Error::NothingToAlign { problem: "there are no points" });
    }
    let start: Vec<DVec3> = points.points.iter().map(|point| point.as_dvec3()).collect();
    let mut alignment = Similarity::default();
    for _ in 0..ROUNDS {
        let normal_equation = |&point: &DVec3| {
            let point = alignment.transform_point(point);
            let found = tree.query(&point.to_array()).nearest_one::<SquaredEuclidean<f64>>().execute();
            if found.distance >= reach * reach {
                return (SMatrix::zeros(), SVector::zeros());
            }
            let nearest = found.item as usize;
            let normal = normals[nearest].as_dvec3();
            let distance = normal.dot(point - DVec3::from(positions[nearest]));
            // By a small turn, shift and growth of the point about the origin.
            let (turn, growth) = (point.cross(normal), point.dot(normal));
            let row =
                SVector::<f64, 7>::from_column_slice(&[turn.x, turn.y, turn.z, normal.x, normal.y, normal.z, growth]);
            (row * row.transpose(), row * -distance)
        };
        let none = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
        let sum = |a: Normal, b: Normal| (a.0 + b.0, a.1 + b.1);
        // In an order that does not depend on the threads.
        let parts: Vec<Normal> =
            start.par_chunks(CHUNK).map(|chunk| chunk.iter().map(normal_equation).fold(none, sum)).collect();
        let (matrix, vector) = parts.into_iter().fold(none, sum);
        let damping = DAMPING * matrix.diagonal().max();
        let Some(step) = (matrix + SMatrix::identity() * damping).cholesky().map(|c| c.solve(&vector)) else { break };
        let step = Similarity {
            scale: step[6].exp(),
            rotation: DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2])),
            translation: DVec3::new(step[3], step[4], step[5]),
        };
        let moved = step.translation.length() + (step.scale - 1.0).abs() + step.rotation.to_scaled_axis().length();
        alignment = step.after(&alignment);
        if moved < SETTLED {
            break;
        }
    }
    Ok(alignment)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Mesh, shapes};
    use crate::metrics::shape::score_surface;
    use crate::sampling::sample_surface;

    #[test]
    fn a_displaced_surface_is_brought_back() {
        let mesh = shapes::cuboid(glam::Vec3::new(-0.15, -0.1, -0.2), glam::Vec3::new(0.15, 0.1, 0.2));
        let displaced = Similarity {
            scale: 1.02,
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.02, -0.015, 0.01),
            translation: DVec3::new(0.01, -0.008, 0.006),
        };
        let moved = Mesh {
            vertices: mesh.vertices.iter().map(|&vertex| displaced.transform_point_f32(vertex)).collect(),
            ..mesh.clone()
        };
        let truth = PointCloud::from(sample_surface(&mesh, 20_000, 1));
        let found = PointCloud::from(sample_surface(&moved, 5_000, 2));
        let alignment = align_to_surface(&found, &truth, f64::INFINITY).unwrap();
        let back = PointCloud {
            points: found.points.iter().map(|&point| alignment.transform_point_f32(point)).collect(),
            ..PointCloud::default()
        };
        let accuracy = |cloud: &PointCloud| score_surface(cloud, &truth, &[]).unwrap().accuracy;
        let floor = accuracy(&PointCloud::from(sample_surface(&mesh, 5_000, 3)));
        assert!(accuracy(&found) > 2.0 * floor, "{} and {floor}", accuracy(&found));
        assert!(accuracy(&back) < 1.05 * floor, "{} and {floor}", accuracy(&back));
        assert!((alignment.scale * 1.02 - 1.0).abs() < 1e-3, "{}", alignment.scale);
    }

    #[test]
    fn a_cloud_without_normals_or_points_is_refused() {
        let cloud = PointCloud { points: vec![glam::Vec3::ZERO], ..PointCloud::default() };
        let truth = PointCloud { normals: Some(vec![glam::Vec3::X]), ..cloud.clone() };
        assert!(align_to_surface(&cloud, &cloud, 1.0).is_err());
        assert!(align_to_surface(&PointCloud::default(), &truth, 1.0).is_err());
        assert!(align_to_surface(&cloud, &truth, 1.0).is_ok());
    }
}
