//! Depths that other views confirm.

use rayon::prelude::*;

use super::depth_map::DepthMap;
use super::picture::Picture;

/// Views that must confirm a depth.
const CONFIRMING: usize = 2;

/// How far the way to another view and back may lead from a pixel, pixels.
const MAX_OFFSET: f32 = 1.0;

/// How far depths may differ, pixels' footprints.
const MAX_DIFFERENCE: f32 = 3.0;

/// Keeps the depths that at least two other views confirm: the point lies where they see the surface, and their surface
/// lies where the pixel is.
pub(super) fn consistent(pictures: &[Picture], neighbours: &[Vec<usize>], maps: &[DepthMap]) -> Vec<DepthMap> {
    let check = |view: usize| {
        let (picture, map) = (&pictures[view], &maps[view]);
        let mut kept = map.clone();
        let limit = MAX_DIFFERENCE * picture.camera.footprint();
        for pixel in 0..map.z_depth.len() {
            let depth = map.z_depth[pixel];
            if depth.is_nan() {
                continue;
            }
            let point = picture.camera.center + depth * picture.direction(pixel);
            let confirms = |&&other: &&usize| {
                let (other_picture, other_map) = (&pictures[other], &maps[other]);
                let (place, z) = other_picture.camera.project(point);
                let Some(there) = other_picture.pixel_at(place) else { return false };
                let other_depth = other_map.z_depth[there];
                let difference = (other_depth - z).abs();
                if difference.is_nan() || difference >= limit {
                    return false;
                }
                // Back along the ray through the place itself, at the depth found there.
                let back = other_picture.camera.center + other_depth * other_picture.camera.direction_through(place);
                let (again, _) = picture.camera.project(back);
                let (own, _) = picture.camera.project(point);
                again.distance(own) < MAX_OFFSET
            };
            let count = neighbours[view].iter().filter(confirms).count();
            if count < CONFIRMING.min(neighbours[view].len()) {
                kept.z_depth[pixel] = f32::NAN;
            }
        }
        kept
    };
    (0..pictures.len()).into_par_iter().map(check).collect()
}
