//! Outlines that other silhouettes contradict: cameras that are not where they are said to be, or masks that are wrong.
//!
//! Where all cameras and masks are right, a ray just inside an outline touches the object, and so passes, somewhere,
//! through all other silhouettes. How many pixels it stays outside of one of them, at best, is by how much two views
//! contradict each other (silhouette coherence: Hernández, Schmitt and Cipolla, *Silhouette Coherence for Camera
//! Calibration under Circular Motion*, PAMI 2007).

use glam::Vec3;
use rayon::prelude::*;

use super::distance::MaskDistance;
use crate::camera::Camera;
use crate::cancellation::{Cancellation, Cancelled};
use crate::ray::UnitCube;

/// Rays along an outline, at most; in all views together, about; and along an outline, at least.
const RAYS: usize = 96;
const ALL_RAYS: usize = 8192;
const FEWEST_RAYS: usize = 8;

/// How far inside the outline these are, in pixels, to half a pixel.
const INSIDE: f32 = 1.0;

/// At the border of the frame, the mask's end is not the object's: so many pixels.
const BORDER: u32 = 3;

/// Samples of a ray within the cube, and of the two spacings around the best of them: where a ray touches an edge, it is
/// inside of all silhouettes for a short way only.
const SAMPLES: usize = 64;
const FINE_SAMPLES: usize = 16;

/// Outlines contradict each other when they are farther apart than this, in pixels: masks are right to one or two.
const APART: f32 = 2.0;

/// With a larger share of contradicted outlines, cameras or masks are off: photographs with masks by hand have up to
/// .08, renders none, and a turn around a head whose end does not meet its beginning .28.
const USUAL: f64 = 0.12;

/// Views that a note names.
const NAMED: usize = 3;

/// How much of each view's outline other views contradict by more than two pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlineContradictions {
    /// For each view, the share of its outline, in `[0, 1]`; `None` where all of it is the frame's, or nothing is seen.
    pub shares: Vec<Option<f64>>,
    /// For each view, in how many contradictions it takes part, as one side or the other, in outlines.
    pub involved: Vec<f64>,
}

impl OutlineContradictions {
    /// Looks for contradictions between views, each with its camera in object space and its mask. The work is bounded:
    /// each view is asked at up to 96 places, fewer where there are more than 85 views.
    ///
    /// # Errors
    /// [`Cancelled`] where somebody wants it to end.
    pub fn find(cameras: &[&Camera], masks: &[MaskDistance], cancellation: &Cancellation) -> Result<Self, Cancelled> {
        let rays = (ALL_RAYS / masks.len().max(1)).clamp(FEWEST_RAYS, RAYS);
        let contradicted_by = (0..masks.len()).into_par_iter().map(|view| {
            cancellation.check()?;
            let outline = outline_rays(cameras[view], &masks[view], rays);
            let found = outline.iter().map(|ray| ray.contradicted_by(masks, view)).collect::<Vec<Option<usize>>>();
            Ok(found)
        });
        let contradicted_by: Vec<Vec<Option<usize>>> = contradicted_by.collect::<Result<_, Cancelled>>()?;
        let mut involved = vec![0.0; masks.len()];
        let mut shares = Vec::with_capacity(masks.len());
        for (view, outline) in contradicted_by.iter().enumerate() {
            let each = 1.0 / outline.len().max(1) as f64;
            let others: Vec<usize> = outline.iter().copied().flatten().collect();
            others.iter().for_each(|&other| involved[other] += each);
            let share = others.len() as f64 * each;
            involved[view] += share;
            shares.push((!outline.is_empty()).then_some(share));
        }
        Ok(Self { shares, involved })
    }

    /// The share of all outlines.
    pub fn share(&self) -> f64 {
        let known = self.shares.iter().flatten();
        let (sum, count) = known.fold((0.0, 0), |(sum, count), share| (sum + share, count + 1));
        sum / f64::from(count.max(1))
    }

    /// What to tell people who may mend it, where there are more contradictions than usual; `names` are the views'.
    pub fn note(&self, names: &[&str]) -> Option<String> {
        let share = self.share();
        if share <= USUAL {
            return None;
        }
        let mut worst: Vec<(f64, &str)> = self.involved.iter().copied().zip(names.iter().copied()).collect();
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let worst: Vec<String> = worst.iter().take(NAMED).map(|(_, name)| format!("`{name}`")).collect();
        Some(format!(
            "other masks contradict {:.0} % of the masks' outlines by more than {APART} pixels, most in {}: cameras or masks \
             are off, and the surface gets ridges there; look at these views, and leave wrong ones out with --ignore NAME",
            100.0 * share,
            worst.join(", ")
        ))
    }
}

/// A ray just inside an outline.
struct OutlineRay {
    origin: Vec3,
    direction: Vec3,
    /// Ray depths where it enters and leaves the cube.
    range: [f32; 2],
    /// Object units of a pixel at ray depth 1.
    pixel: f32,
}

/// At most about so many rays, evenly along the outline.
fn outline_rays(camera: &Camera, mask: &MaskDistance, most: usize) -> Vec<OutlineRay> {
    let (width, height) = (camera.width, camera.height);
    let rows = BORDER..height.saturating_sub(BORDER);
    let is_outline = |u: u32, v: u32| (mask.of_pixel(u, v) - INSIDE).abs() < 0.5;
    let outline: Vec<(u32, u32)> = rows
        .flat_map(|v| (BORDER..width.saturating_sub(BORDER)).filter(move |&u| is_outline(u, v)).map(move |u| (u, v)))
        .collect();
    let focal = 0.5 * (camera.intrinsics.x_axis.x.abs() + camera.intrinsics.y_axis.y.abs());
    let ray = |(u, v): (u32, u32)| {
        let ray = camera.pixel_ray(u, v);
        let (near, far) = UnitCube::default().intersect(&ray)?;
        Some(OutlineRay {
            origin: ray.origin.as_vec3(),
            direction: ray.direction.as_vec3(),
            range: [near as f32, far as f32],
            pixel: focal.recip() as f32,
        })
    };
    let step = outline.len().div_ceil(most).max(1);
    outline.into_iter().step_by(step).filter_map(ray).collect()
}

impl OutlineRay {
    /// The view, other than the ray's `own`, whose silhouette keeps it out most where it gets farthest into all of
    /// them; `None` where it gets in, to about what masks are right to.
    fn contradicted_by(&self, masks: &[MaskDistance], own: usize) -> Option<usize> {
        let [near, far] = self.range;
        let spacing = (far - near) / SAMPLES as f32;
        let mut best = (f32::NEG_INFINITY, own);
        let mut best_depth = near;
        for i in 0..SAMPLES {
            let depth = near + (i as f32 + 0.5) * spacing;
            if let Some(found) = self.least_distance(depth, best.0, masks, own) {
                (best, best_depth) = (found, depth);
            }
        }
        let middle = best_depth;
        for i in 0..FINE_SAMPLES {
            let depth = middle + (2.0 * (i as f32 + 0.5) / FINE_SAMPLES as f32 - 1.0) * spacing;
            best = self.least_distance(depth, best.0, masks, own).unwrap_or(best);
        }
        (best.0 < -APART).then_some(best.1)
    }

    /// The least distance inside of another silhouette at a ray depth, in the ray's pixels, and whose it is; if it is
    /// more than `best`.
    fn least_distance(&self, depth: f32, best: f32, masks: &[MaskDistance], own: usize) -> Option<(f32, usize)> {
        let point = self.origin + depth * self.direction;
        let mut least = (f32::INFINITY, own);
        for (view, mask) in masks.iter().enumerate().filter(|&(view, _)| view != own) {
            if let Some(distance) = mask.at(point) {
                let pixels = distance / (self.pixel * depth);
                if pixels <= best {
                    return None;
                }
                if pixels < least.0 {
                    least = (pixels, view);
                }
            }
        }
        Some(least)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use image::{GrayImage, Luma};

    use super::*;
    use crate::raster::Mask;

    /// Twenty-four views of a slab with sharp edges, around it.
    fn views() -> Vec<(Camera, Mask)> {
        let half = DVec3::new(0.35, 0.1, 0.25);
        let view = |i: usize| {
            let angle = f64::from(i as u32) * std::f64::consts::TAU / 24.0;
            let eye = DVec3::new(1.8 * angle.cos(), 0.6 * (2.0 * angle).sin() + 0.7, 1.8 * angle.sin());
            let camera = Camera::look_at(128, 128, 150.0, eye, DVec3::ZERO, DVec3::Y);
            let coverage = GrayImage::from_fn(128, 128, |u, v| {
                let ray = camera.pixel_ray(u, v);
                let (a, b) = ((-half - ray.origin) / ray.direction, (half - ray.origin) / ray.direction);
                Luma([if a.min(b).max_element() <= a.max(b).min_element() { 255 } else { 0 }])
            });
            (camera, Mask::from(coverage))
        };
        (0..24).map(view).collect()
    }

    fn found(views: &[(Camera, Mask)]) -> OutlineContradictions {
        let masks: Vec<MaskDistance> = views.iter().map(|(camera, mask)| MaskDistance::new(camera, mask)).collect();
        let cameras: Vec<&Camera> = views.iter().map(|(camera, _)| camera).collect();
        OutlineContradictions::find(&cameras, &masks, &Cancellation::default()).unwrap()
    }

    #[test]
    fn outlines_of_right_cameras_fit_together() {
        let found = found(&views());
        assert_eq!(found.share(), 0.0, "{:?}", found.shares);
        assert_eq!(found.note(&[""; 24]), None);
    }

    #[test]
    fn a_camera_that_is_off_contradicts_the_others_most() {
        let mut views = views();
        // The picture lies eight pixels beside where the camera says.
        views[5].0.intrinsics.z_axis.x += 8.0;
        let found = found(&views);
        assert!(found.shares[5].is_some_and(|share| share > 0.2), "{:?}", found.shares);
        let others = found.involved.iter().enumerate().filter(|(i, _)| *i != 5).map(|(_, involved)| *involved);
        assert!(found.involved[5] > 2.0 * others.fold(0.0, f64::max), "{:?}", found.involved);
        let names: Vec<String> = (0..24).map(|i| i.to_string()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let note = found.note(&names).expect("each outline is contradicted by that view");
        assert!(note.contains("most in `5`"), "{note}");
    }

    #[test]
    fn a_turn_that_does_not_close_is_told_with_the_views_that_are_farthest_off() {
        let mut views = views();
        for (i, (camera, _)) in views.iter_mut().enumerate() {
            camera.intrinsics.z_axis.y += 0.5 * i as f64;
        }
        let found = found(&views);
        let names: Vec<String> = (0..24).map(|i| i.to_string()).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let note = found.note(&names).expect("the ends are twelve pixels apart");
        assert!(note.contains("--ignore") && note.contains('%'), "{note}");
    }

    #[test]
    fn what_the_frame_cuts_is_no_outline() {
        let mut views = views();
        views[3].1.coverage.fill(255);
        views[7].1.coverage.fill(0);
        let found = found(&views);
        assert_eq!((found.shares[3], found.shares[7]), (None, None));
        // The view that shows nothing contradicts all others.
        assert!(found.share() > 0.9, "{:?}", found.shares);
    }

    #[test]
    fn it_ends_when_nobody_wants_it() {
        let views = views();
        let masks: Vec<MaskDistance> = views.iter().map(|(camera, mask)| MaskDistance::new(camera, mask)).collect();
        let cameras: Vec<&Camera> = views.iter().map(|(camera, _)| camera).collect();
        let cancellation = Cancellation::default();
        cancellation.cancel();
        assert!(OutlineContradictions::find(&cameras, &masks, &cancellation).is_err());
    }
}
