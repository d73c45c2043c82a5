//! Outward unit normals at the vertices: from the field's gradient, or from the faces.

use glam::Vec3;

use super::error::Result;
use super::sampler::{Sampler, check};
use crate::field::scalar::ScalarField;

/// Normals `-g / |g|` from the gradient `g` of the logit; `fallback` where there is no gradient.
///
/// `step` is the half-width of the central differences that stand in for a field without gradients.
pub(super) fn field_normals<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    points: &[Vec3],
    step: f32,
    fallback: &[Vec3],
) -> Result<Vec<Vec3>> {
    let mut normals = Vec::with_capacity(points.len());
    for batch in points.chunks(sampler.max_points) {
        sampler.cancellation.check()?;
        let gradients = match sampler.field.gradients(batch) {
            Some(gradients) => {
                check("gradients", batch, &gradients, |gradient| gradient.is_finite())?;
                sampler.evaluations += batch.len();
                gradients
            }
            None => central_differences(sampler, batch, step)?,
        };
        let fallback = &fallback[normals.len()..];
        normals.extend(gradients.iter().zip(fallback).map(|(&g, &fallback)| direction(-g).unwrap_or(fallback)));
    }
    Ok(normals)
}

/// The unit vector along a vector of any length but zero, be it too long or too short to be squared.
fn direction(vector: Vec3) -> Option<Vec3> {
    (vector / vector.abs().max_element()).try_normalize()
}

/// The direction of the gradient, to second order in `step`. Its length is not scaled.
fn central_differences<F: ScalarField + ?Sized>(
    sampler: &mut Sampler<F>,
    points: &[Vec3],
    step: f32,
) -> Result<Vec<Vec3>> {
    let mut gradients = vec![Vec3::ZERO; points.len()];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let moved: Vec<Vec3> = points.iter().map(|&point| point + sign * step * Vec3::AXES[axis]).collect();
            for (gradient, value) in gradients.iter_mut().zip(sampler.values(&moved)?) {
                // Halved, so that the difference of two huge logits stays finite.
                gradient[axis] += sign * 0.5 * value;
            }
        }
    }
    Ok(gradients)
}

/// The mean of the normals of a vertex's faces, weighted by area.
pub(super) fn face_normals(vertices: &[Vec3], faces: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; vertices.len()];
    for face in faces {
        let [a, b, c] = face.map(|vertex| vertices[vertex as usize]);
        let area_vector = (b - a).cross(c - a);
        face.iter().for_each(|&vertex| sums[vertex as usize] += area_vector);
    }
    // A vertex whose faces cancel has no direction; any unit vector is as good as another.
    sums.into_iter().map(|sum| sum.try_normalize().unwrap_or(Vec3::Z)).collect()
}

#[cfg(test)]
mod tests {
    use dvr_core::Cancellation;

    use super::*;

    #[test]
    fn where_the_field_is_flat_the_faces_tell_the_normal() {
        let flat = |points: &[Vec3]| vec![0.5; points.len()];
        let mut sampler = Sampler::new(&flat, 0.0, 2, Cancellation::default());
        let normals = field_normals(&mut sampler, &[Vec3::ZERO; 3], 0.1, &[Vec3::X, Vec3::Y, Vec3::Z]).unwrap();
        assert_eq!(normals, [Vec3::X, Vec3::Y, Vec3::Z]);
    }

    #[test]
    fn a_saturated_field_still_has_finite_normals() {
        let step = |points: &[Vec3]| points.iter().map(|p| if p.x < 0.0 { f32::INFINITY } else { -1e38 }).collect();
        let mut sampler = Sampler::new(&step, 0.0, 8, Cancellation::default());
        assert_eq!(field_normals(&mut sampler, &[Vec3::ZERO], 0.1, &[Vec3::Y]).unwrap(), [Vec3::X]);
    }

    #[test]
    fn a_vertex_of_a_flat_fan_has_the_plane_s_normal() {
        let vertices = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
        assert_eq!(face_normals(&vertices, &[[0, 1, 2]])[..3], [Vec3::Z; 3]);
    }
}
