//! Masks that no shape can explain.

use glam::DVec3;
use rayon::prelude::*;

use super::settings::HullSettings;
use super::silhouette::{Sight, Silhouette};
use super::visual_hull::VisualHull;
use crate::camera::Camera;
use crate::error::Result;
use crate::raster::Mask;

/// For each view, the share of the mask's object pixels whose ray meets no voxel of the hull (to about a voxel's
/// width); 0 for a mask without object.
///
/// Every part of a right mask is explained by the hull. What is not is where this mask disagrees with another one: a
/// wrong mask, a wrong camera, or a part that moved. The hull must have been carved from (about) the same views, in a
/// box that holds the object. A few per cent are usual for masks that are right to a pixel or two.
///
/// # Errors
/// When a mask has another size than its camera's image.
pub fn silhouette_consistency(views: &[(&Camera, &Mask)], hull: &VisualHull) -> Result<Vec<f64>> {
    Ok(unexplained(&Silhouette::all(views)?, hull, hull.voxel_size()))
}

/// [`silhouette_consistency`] of views that are prepared already, to about the width that is given.
pub(super) fn unexplained(silhouettes: &[Silhouette], hull: &VisualHull, width: DVec3) -> Vec<f64> {
    let centers = hull.surface_centers();
    let half = 0.5 * width;
    silhouettes
        .par_iter()
        .map(|silhouette| {
            let [width, height] = silhouette.size();
            // A corner of each voxel's pixel box counts +-1; the prefix sum then counts the boxes over each pixel.
            let mut boxes = vec![0i32; (width + 1) * (height + 1)];
            for &center in &centers {
                let footprint = silhouette.footprint(center, half, 0.0);
                let Some([x, y]) = footprint.and_then(|[low, high]| silhouette.pixels(low, high)) else { continue };
                for (row, sign) in [(y.start, 1), (y.end, -1)] {
                    boxes[row * (width + 1) + x.start] += sign;
                    boxes[row * (width + 1) + x.end] -= sign;
                }
            }
            let (mut object, mut missed) = (0usize, 0usize);
            let mut above = vec![0i32; width];
            for y in 0..height {
                let mut row = 0;
                for x in 0..width {
                    row += boxes[y * (width + 1) + x];
                    above[x] += row;
                    if silhouette.is_object(x, y) {
                        object += 1;
                        missed += usize::from(above[x] == 0);
                    }
                }
            }
            if object == 0 { 0.0 } else { missed as f64 / object as f64 }
        })
        .collect()
}

/// For each view, the share of the hull (by the centres of its surface voxels) that it sees as background.
pub(super) fn rejected(silhouettes: &[Silhouette], hull: &VisualHull, settings: &HullSettings) -> Vec<f64> {
    let centers = hull.surface_centers();
    let half = 0.5 * hull.voxel_size();
    silhouettes
        .par_iter()
        .map(|silhouette| {
            let sees_background =
                |&&center: &&glam::DVec3| silhouette.look(center, half, settings.margin) == Sight::Background;
            let count = centers.iter().filter(sees_background).count();
            if centers.is_empty() { 0.0 } else { count as f64 / centers.len() as f64 }
        })
        .collect()
}
