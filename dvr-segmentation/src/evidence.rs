//! What depths say at once: what stands on the support plane is the object, what lies on it or beyond the cube is not.

use std::ops::Range;

use dvr_core::{Cancellation, Cancelled};
use glam::Vec3;
use rayon::prelude::*;

use crate::HALF;
use crate::plane_sweep::{Reach, depths};
use crate::shrunk::Shrunk;
use crate::static_background::static_pixels;
use crate::support_plane::{SupportPlane, support_plane};

/// The object is looked for up to this far beyond the cube's middle, as a share of its half edge: a little further.
const SWEPT: f32 = 1.1;

/// What stands out of the plane by this is the object's for certain, object units.
const STANDING: f32 = 0.02;

/// Points that the support plane is looked for among.
const POINTS: usize = 20_000;

/// Where nothing is known to be the object's within this share of a picture's longer side, the frame does not cut it, and what it
/// shows is background.
const CUT: f32 = 0.1;

/// Where less than this share of all pixels is known to be the object, the middle is taken for it: all that is nearer to what
/// the cameras look at than this share of a picture's side.
const LITTLE: f64 = 0.01;
const SEED: f32 = 0.08;

/// Pixels that count as the frame.
const FRAME: usize = 2;

/// Half the side of the window in which nothing may contradict a pixel.
const WINDOW: usize = 2;

/// What depths say.
pub(crate) struct Evidence {
    /// Per view and pixel: 1 object, -1 background, 0 nothing.
    pub says: Vec<Vec<f32>>,
    /// What the object stands on.
    pub support: Option<SupportPlane>,
    /// Pixels that stand still while the object turns, in all views; empty where pictures differ in size.
    pub stands_still: Vec<bool>,
}

impl Evidence {
    /// Compares the views; those that are not `asked` have no say in what the others show.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn of(
        views: &[Shrunk],
        asked: &[bool],
        cancellation: &Cancellation,
        done: &(dyn Fn() + Sync),
    ) -> Result<Self, Cancelled> {
        let reach = Reach { before: SWEPT * HALF, behind: SWEPT * HALF };
        let known = depths(views, asked, reach, cancellation, done)?;
        let points: Vec<Vec<Option<Vec3>>> = (views.par_iter().zip(&known))
            .map(|(view, depths)| {
                let point = |(pixel, &depth): (usize, &f32)| {
                    let direction = view.camera.direction_through(view.middle(pixel));
                    depth.is_finite().then(|| view.camera.center + depth * direction)
                };
                depths.iter().enumerate().map(point).collect()
            })
            .collect();
        let is_near = |point: &Vec3| point.abs().max_element() < HALF;
        let of_asked = points.iter().zip(asked).filter(|(_, asked)| **asked).flat_map(|(points, _)| points);
        let near: Vec<Vec3> = of_asked.flatten().copied().filter(is_near).collect();
        let sample: Vec<Vec3> = near.iter().copied().step_by((near.len() / POINTS).max(1)).collect();
        let centers: Vec<Vec3> =
            views.iter().zip(asked).filter(|(_, asked)| **asked).map(|(view, _)| view.camera.center).collect();
        let support = support_plane(&sample, &centers);
        let is_object = |point: Vec3| is_near(&point) && support.is_none_or(|plane| plane.distance(point) > STANDING);
        let mut says: Vec<Vec<f32>> = (points.par_iter().zip(views))
            .map(|(points, view)| {
                let says = |point: &Option<Vec3>| point.map_or(0.0, |point| if is_object(point) { 1.0 } else { -1.0 });
                unanimous(&points.iter().map(says).collect::<Vec<f32>>(), view.width)
            })
            .collect();
        // The depth of what stands still while the object turns may be anything.
        let stands_still = static_pixels(views, asked);
        for says in &mut says {
            let still = says.iter_mut().zip(&stands_still).filter(|(_, still)| **still);
            still.for_each(|(says, _)| *says = says.min(0.0));
        }
        // Windows leave no depth beside the frame. Pixels there are background where none that is known to be the object's is near.
        for (says, view) in says.iter_mut().zip(views) {
            let reach = (CUT * view.width.max(view.height) as f32) as usize;
            let of_object = |&pixel: &usize| {
                let (mut rows, columns) = window(pixel, reach, view.width, view.height);
                rows.any(|v| columns.clone().any(|u| says[v * view.width + u] > 0.0))
            };
            let frame: Vec<usize> = view.border(0, FRAME).into_iter().filter(|pixel| !of_object(pixel)).collect();
            frame.into_iter().for_each(|pixel| says[pixel] = -1.0);
        }
        let shown = says.iter().zip(asked).filter(|(_, asked)| **asked).flat_map(|(says, _)| says);
        let (object, pixels) =
            shown.fold((0usize, 0usize), |(object, all), &says| (object + usize::from(says > 0.0), all + 1));
        if (object as f64) < LITTLE * pixels as f64 {
            // Nothing could be compared: what all cameras look at is the object's.
            for (says, view) in says.iter_mut().zip(views) {
                let (middle, _) = view.camera.project(Vec3::ZERO);
                let radius = SEED * view.width.min(view.height) as f32;
                let seed = (0..view.len()).filter(|&pixel| view.middle(pixel).distance(middle) < radius);
                seed.for_each(|pixel| says[pixel] = 1.0);
            }
        }
        Ok(Self { says, support, stands_still })
    }
}

/// What a pixel says where nothing near it says otherwise: windows of pixels at an outline have the depth of either side.
fn unanimous(says: &[f32], width: usize) -> Vec<f32> {
    let of_pixel = |pixel: usize| {
        let (rows, columns) = window(pixel, WINDOW, width, says.len() / width);
        let mut around = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
        if around.any(|other| says[other] * says[pixel] < 0.0) { 0.0 } else { says[pixel] }
    };
    (0..says.len()).map(of_pixel).collect()
}

/// Rows and columns that are up to `reach` from a pixel, within a picture.
fn window(pixel: usize, reach: usize, width: usize, height: usize) -> (Range<usize>, Range<usize>) {
    let around = |at: usize, side: usize| at.saturating_sub(reach)..(at + reach + 1).min(side);
    (around(pixel / width, height), around(pixel % width, width))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_believed_where_nothing_near_them_says_otherwise() {
        let row = [1.0, 1.0, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, 0.0, 0.0];
        assert_eq!(unanimous(&row, row.len()), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0, -1.0, -1.0, 0.0, 0.0]);
    }
}
