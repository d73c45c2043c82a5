//! Masks that show something else than the others.

use super::bounds::Bounds;
use super::consistency::{rejected, unexplained};
use super::settings::HullSettings;
use super::silhouette::Silhouette;
use super::visual_hull::VisualHull;
use crate::camera::Camera;
use crate::error::Result;
use crate::raster::Mask;

/// Fewer masks have no majority that could outvote one.
const MIN_VIEWS: usize = 8;

/// The share of all views that may be wrong: one in four.
const MINORITY: usize = 4;

/// Voxels along an edge while wrong masks are looked for.
const RESOLUTION: usize = 48;

/// A mask is wrong when more than this share of its object is nothing to most of the others: a right one has next to
/// none.
const WRONG: f64 = 0.3;

/// A mask is wrong, too, when it sees this share of what most of the others agree on as background.
const BLIND: f64 = 0.9;

/// Views whose masks show something else than most of the others, or nothing; in order.
///
/// A right mask's object is explained by what three quarters of all views do not rule out, whatever the rest says. One
/// that is not is wrong as a whole. None is where more than a quarter would be: those cannot be distinguished from the rest.
///
/// # Errors
/// When a mask has another size than its camera's image, or the box is empty.
pub fn wrong_masks(views: &[(&Camera, &Mask)], bounds: Bounds) -> Result<Vec<usize>> {
    let minority = views.len() / MINORITY;
    if views.len() < MIN_VIEWS {
        return Ok(Vec::new());
    }
    let silhouettes = Silhouette::all(views)?;
    let settings = HullSettings { max_disagreeing: minority, ..HullSettings::default() };
    let core = VisualHull::carve_silhouettes(&silhouettes, bounds, RESOLUTION, &settings)?;
    let wrong: Vec<usize> = (unexplained(&silhouettes, &core, core.voxel_size()).into_iter())
        .zip(rejected(&silhouettes, &core, &settings))
        .enumerate()
        .filter(|(_, (unexplained, rejected))| *unexplained > WRONG || *rejected > BLIND)
        .map(|(view, _)| view)
        .collect();
    Ok(if wrong.len() > minority || core.is_empty() { Vec::new() } else { wrong })
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};
    use image::{GrayImage, Luma};

    use super::*;

    const CUBE: Bounds = Bounds::UNIT_CUBE;

    /// Sixteen views of a ball.
    fn ball() -> Vec<(Camera, Mask)> {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let view = |i: usize| {
            let height = 1.0 - (2.0 * i as f64 + 1.0) / 16.0;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let radius = (1.0 - height * height).sqrt();
            let eye = 1.5 * DVec3::new(radius * cos, height, radius * sin);
            let camera = Camera::look_at(48, 48, 42.0, eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0));
            let coverage = GrayImage::from_fn(48, 48, |u, v| {
                let ray = camera.ray(DVec2::new(f64::from(u) + 0.5, f64::from(v) + 0.5));
                let nearest = ray.at(-ray.origin.dot(ray.direction) / ray.direction.length_squared());
                Luma([if nearest.length() < 0.35 { 255 } else { 0 }])
            });
            (camera, Mask::from(coverage))
        };
        (0..16).map(view).collect()
    }

    fn wrong(views: &[(Camera, Mask)]) -> Vec<usize> {
        let views: Vec<(&Camera, &Mask)> = views.iter().map(|(camera, mask)| (camera, mask)).collect();
        wrong_masks(&views, CUBE).unwrap()
    }

    #[test]
    fn masks_that_fit_together_are_believed() {
        assert_eq!(wrong(&ball()), [0; 0]);
    }

    #[test]
    fn masks_that_show_nothing_or_something_else_stand_out() {
        let mut views = ball();
        views[3].1.coverage.fill(0);
        views[7].1.coverage.pixels_mut().for_each(|pixel| pixel.0[0] = 255 - pixel.0[0]);
        assert_eq!(wrong(&views), [3, 7]);
    }

    #[test]
    fn a_few_masks_have_no_majority() {
        let mut views = ball();
        views.truncate(5);
        views[2].1.coverage.fill(0);
        assert_eq!(wrong(&views), [0; 0]);
    }
}
