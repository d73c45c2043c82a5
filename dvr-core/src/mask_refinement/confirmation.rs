//! Confirmation by other masks: what one mask leaves out is the object's where the others say so.

use glam::DVec3;

use crate::camera::Camera;
use crate::flood::flood;
use crate::raster::Mask;
use crate::ray::UnitCube;
use crate::scene::{Split, View};

/// Points along a ray through the unit cube.
const POINTS: usize = 512;

/// Masks that must show a point; with fewer there is no majority.
const WITNESSES: usize = 2;

/// Of `missing`, pixels of the view at `index`, those whose regions the masks of the other views confirm.
///
/// A pixel is confirmed where its ray meets a point that is object in all other views that have it in their frames, a
/// pixel within their outlines. A region, connected by edges or corners, counts where most of its pixels do: pixels at
/// its border may be mixed.
pub(super) fn confirmed(views: &[View], index: usize, missing: &[usize]) -> Vec<usize> {
    let others = views.iter().enumerate().filter(|(other, view)| *other != index && view.split != Split::Test);
    let witnesses: Vec<(&Camera, &Mask)> =
        others.filter_map(|(_, view)| Some((&view.camera, view.mask.as_ref()?))).collect();
    let camera = &views[index].camera;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut left = vec![false; width * height];
    missing.iter().for_each(|&pixel| left[pixel] = true);
    let around = |pixel: usize| {
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
        rows.flat_map(move |y| (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |x| y * width + x))
    };
    let mut kept = Vec::new();
    for &start in missing {
        if left[start] {
            let region = flood(start, &mut left, around);
            let count = region.iter().filter(|&&pixel| is_confirmed(camera, pixel, &witnesses)).count();
            if 2 * count > region.len() {
                kept.extend(region);
            }
        }
    }
    kept.sort_unstable();
    kept
}

/// Whether the ray of a pixel meets a point that all witnesses show.
fn is_confirmed(camera: &Camera, pixel: usize, witnesses: &[(&Camera, &Mask)]) -> bool {
    let (u, v) = (pixel as u32 % camera.width, pixel as u32 / camera.width);
    let ray = camera.pixel_ray(u, v);
    let Some((near, far)) = UnitCube::default().intersect(&ray) else { return false };
    (0..POINTS).any(|i| {
        let point = ray.at(near + (far - near) * (i as f64 + 0.5) / POINTS as f64);
        let mut seeing = 0;
        witnesses.iter().all(|(camera, mask)| match shows(camera, mask, point) {
            Some(shown) => {
                seeing += usize::from(shown);
                shown
            }
            None => true,
        }) && seeing >= WITNESSES
    })
}

/// Whether a view shows a point a pixel or more within the object's outline; `None` where it does not see it.
fn shows(camera: &Camera, mask: &Mask, point: DVec3) -> Option<bool> {
    let (at, z) = camera.project(point);
    if z <= 0.0 || !camera.sees(at) {
        return None;
    }
    let (u, v) = (at.x as u32, at.y as u32);
    let (width, height) = mask.size();
    let beside = [(u, v), (u.saturating_sub(1), v), (u + 1, v), (u, v.saturating_sub(1)), (u, v + 1)];
    Some(beside.into_iter().all(|(u, v)| mask.is_object(u.min(width - 1), v.min(height - 1))))
}
