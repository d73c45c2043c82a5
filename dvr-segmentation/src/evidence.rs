//! What depths say at once: what stands on the support plane is the object, what lies on it or beyond the cube is not.

use dvr_core::{Cancellation, Cancelled};
use glam::Vec3;
use rayon::prelude::*;

use crate::HALF;
use crate::plane_sweep::{Reach, depths};
use crate::shrunk::Shrunk;
use crate::support_plane::{SupportPlane, support_plane};

/// The object is looked for up to this far beyond the cube's middle, as a share of its half edge: a little further.
const SWEPT: f32 = 1.1;

/// What stands out of the plane by this is the object's for certain, object units.
const STANDING: f32 = 0.02;

/// Points that the support plane is looked for among.
const POINTS: usize = 20_000;

/// Where not more than this share of the frames' pixels show the object, frames hardly cut it, and what they show is
/// background.
const CUT: f64 = 0.1;

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
        // Beside the frame no depth is known: windows leave it there.
        let inner = |view: &Shrunk| view.border(FRAME, 3 * FRAME);
        let of_asked = || says.iter().zip(views).zip(asked).filter(|(_, asked)| **asked).map(|(view, _)| view);
        let cut: usize =
            of_asked().map(|(says, view)| inner(view).into_iter().filter(|&pixel| says[pixel] > 0.0).count()).sum();
        let all: usize = of_asked().map(|(_, view)| inner(view).len()).sum();
        if cut as f64 <= CUT * all as f64 {
            for (says, view) in says.iter_mut().zip(views) {
                view.border(0, FRAME).into_iter().for_each(|pixel| says[pixel] = -1.0);
            }
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
        Ok(Self { says, support })
    }
}

/// What a pixel says where nothing near it says otherwise: windows of pixels at an outline have the depth of either side.
fn unanimous(says: &[f32], width: usize) -> Vec<f32> {
    let height = says.len() / width;
    let of_pixel = |pixel: usize| {
        let (u, v) = (pixel % width, pixel / width);
        let rows = v.saturating_sub(WINDOW)..(v + WINDOW + 1).min(height);
        let columns = u.saturating_sub(WINDOW)..(u + WINDOW + 1).min(width);
        let mut around = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
        if around.any(|other| says[other] * says[pixel] < 0.0) { 0.0 } else { says[pixel] }
    };
    (0..says.len()).map(of_pixel).collect()
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
