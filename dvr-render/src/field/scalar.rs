//! A field as numbers on the CPU: what extraction asks, and what a fast field answers without tensors.

use glam::Vec3;

/// An implicit function, known by evaluation at batches of points only.
///
/// Any closure from points to logits is one, and every [`Field`](crate::Field) through
/// [`FieldSurface`](crate::extract::FieldSurface). Batches are at most [`ExtractSettings::max_points`] long and come one
/// after the other: spread the work over threads or a GPU inside the implementation.
///
/// [`ExtractSettings::max_points`]: crate::extract::ExtractSettings::max_points
pub trait ScalarField {
    /// The occupancy logit at each point, positive inside.
    fn logits(&self, points: &[Vec3]) -> Vec<f32>;

    /// The gradient of the logit at each point, or `None` if only [`ScalarField::logits`] can be had; normals then come
    /// from central differences, six evaluations per vertex.
    fn gradients(&self, points: &[Vec3]) -> Option<Vec<Vec3>> {
        let _ = points;
        None
    }

    /// The sRGB colour in `[0, 1]` at each point of the surface, or `None` if the field has no colour.
    ///
    /// `normals` are the outward unit normals at the points, `directions` the unit viewing directions from the camera
    /// to them, for fields whose colour depends on these. Without directions (as in extraction) the colour is one that
    /// does not depend on the view.
    fn colors(&self, points: &[Vec3], normals: &[Vec3], directions: Option<&[Vec3]>) -> Option<Vec<[f32; 3]>> {
        let _ = (points, normals, directions);
        None
    }

    /// Cells along an edge of the padded cube, where the field lies on a grid and is interpolated between its nodes: there is
    /// nothing finer in it. `None` for any other field.
    fn cells(&self) -> Option<usize> {
        None
    }
}

impl<F: Fn(&[Vec3]) -> Vec<f32>> ScalarField for F {
    fn logits(&self, points: &[Vec3]) -> Vec<f32> {
        self(points)
    }
}
