//! Training views with the edges of the box within which the surface was looked for.

use dvr_core::hull::Bounds;
use dvr_core::{Camera, View};
use dvr_train::preview::limited;
use glam::{DVec2, DVec3};
use image::RgbImage;
use image::imageops::{FilterType, resize};

use crate::error::Result;
use crate::pictures::jpeg;

/// How near to the camera an edge is drawn, in object units: what is behind it has no picture.
const NEAREST: f64 = 1e-3;

/// A photograph with a box.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionPicture {
    /// The view's name.
    pub name: String,
    /// Size in pixels.
    pub size: (u32, u32),
    /// The photograph, as a `data:` address.
    pub photo: String,
    /// The ends of the box's edges that are before the camera, in pixels.
    pub edges: Vec<[DVec2; 2]>,
}

impl RegionPicture {
    /// The view in at most `max_width` pixels, with the edges of a box in object space.
    ///
    /// # Errors
    /// When the picture cannot be encoded.
    pub fn of(view: &View, bounds: &Bounds, max_width: u32) -> Result<Self> {
        let camera = limited(&view.camera, max_width);
        let (width, height) = (camera.width, camera.height);
        let (full_width, full_height) = view.image.dimensions();
        let photo = RgbImage::from_fn(full_width, full_height, |u, v| *view.image.get_pixel(u, v));
        let photo = if (full_width, full_height) == (width, height) {
            photo
        } else {
            resize(&photo, width, height, FilterType::Triangle)
        };
        let edges = edges(bounds).into_iter().filter_map(|edge| projected(&camera, edge)).collect();
        Ok(Self { name: view.name.clone(), size: (width, height), photo: jpeg(&photo)?, edges })
    }
}

/// The twelve edges of a box.
fn edges(bounds: &Bounds) -> Vec<[DVec3; 2]> {
    let corner = |i: usize| {
        let at = |axis: usize| if i & (1 << axis) == 0 { bounds.min[axis] } else { bounds.max[axis] };
        DVec3::new(at(0), at(1), at(2))
    };
    let along = |i: usize| (0..3).filter(move |axis| i & (1 << axis) == 0).map(move |axis| (i, i | (1 << axis)));
    (0..8).flat_map(along).map(|(from, to)| [corner(from), corner(to)]).collect()
}

/// The picture of an edge, of which what is behind the camera is cut off; `None` where all of it is.
fn projected(camera: &Camera, [from, to]: [DVec3; 2]) -> Option<[DVec2; 2]> {
    let depth = |point: DVec3| camera.project(point).1;
    let (near, far) = (depth(from) - NEAREST, depth(to) - NEAREST);
    if near.max(far) <= 0.0 {
        return None;
    }
    let cut = from.lerp(to, near / (near - far));
    let ends = [if near < 0.0 { cut } else { from }, if far < 0.0 { cut } else { to }];
    Some(ends.map(|point| camera.project(point).0))
}

#[cfg(test)]
mod tests {
    use dvr_core::stored;

    use super::*;

    #[test]
    fn a_box_before_the_camera_has_twelve_edges_and_what_is_behind_it_is_cut() {
        let view = |eye: DVec3| {
            let camera = Camera::look_at(40, 30, 30.0, eye, eye - DVec3::Z, DVec3::Y);
            View::new("a", camera, stored(RgbImage::new(40, 30)), None)
        };
        let before = RegionPicture::of(&view(2.0 * DVec3::Z), &Bounds::UNIT_CUBE, 20).unwrap();
        assert_eq!((before.size, before.edges.len()), ((20, 15), 12));
        // The near face is 1.5 away: half an edge is five pixels of the smaller picture.
        let ends: Vec<DVec2> = before.edges.iter().flatten().copied().collect();
        assert!(ends.iter().any(|end| (*end - DVec2::new(15.0, 12.5)).length() < 1e-9), "{ends:?}");
        // From within, the face behind the camera has no picture, and edges to it are cut.
        let within = RegionPicture::of(&view(DVec3::ZERO), &Bounds::UNIT_CUBE, 40).unwrap();
        assert_eq!(within.edges.len(), 8);
        assert!(within.edges.iter().flatten().all(|end| end.is_finite()));
        assert!(RegionPicture::of(&view(-2.0 * DVec3::Z), &Bounds::UNIT_CUBE, 40).unwrap().edges.is_empty());
    }
}
