//! Depths that other views confirm.

use std::collections::HashMap;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::plane_sweep::SweptPixel;
use crate::views::TrainingView;

/// Other views that must find a point nearby.
const CONFIRMING: usize = 2;

/// Forgets each depth whose point has no points of two other views within `reach`. A plain patch that matches
/// somewhere by chance matches elsewhere in the next view.
pub(super) fn forget_unconfirmed(views: &[TrainingView], swept: &mut [Vec<SweptPixel>], reach: f32) {
    let point =
        |view: usize, pixel: &SweptPixel| pixel.depth.map(|depth| views[view].camera.center + depth * pixel.direction);
    let bin = |point: Vec3| (point / reach).floor().as_ivec3();
    let mut bins: HashMap<IVec3, Vec<(usize, Vec3)>> = HashMap::new();
    for (view, pixels) in swept.iter().enumerate() {
        for found in pixels.iter().filter_map(|pixel| point(view, pixel)) {
            bins.entry(bin(found)).or_default().push((view, found));
        }
    }
    let is_confirmed = |view: usize, own: Vec3| {
        let center = bin(own);
        let bins_around = (0..27).filter_map(|i| bins.get(&(center + IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1))));
        let mut others = [view; CONFIRMING];
        let mut count = 0;
        for &(other, found) in bins_around.flatten() {
            if other != view && !others[..count].contains(&other) && found.distance_squared(own) < reach * reach {
                others[count] = other;
                count += 1;
                if count == CONFIRMING {
                    return true;
                }
            }
        }
        false
    };
    swept.par_iter_mut().enumerate().for_each(|(view, pixels)| {
        for pixel in pixels {
            if point(view, pixel).is_some_and(|point| !is_confirmed(view, point)) {
                pixel.depth = None;
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::GridLosses;
    use crate::step::suite::Fixture;

    #[test]
    fn a_depth_stays_where_two_other_views_find_the_point() {
        let fixture = Fixture::ball(0.3, GridLosses::default());
        let points = [Vec3::new(0.1, 0.2, 0.0), Vec3::new(-0.2, 0.0, 0.1)];
        // The first point is seen by three views, each a little off, the second by two.
        let sees = |view: usize, point: usize| view + point < 3;
        let mut swept: Vec<Vec<SweptPixel>> = (fixture.views.iter().enumerate())
            .map(|(view, of)| {
                let seen = (0..points.len()).filter(|&point| sees(view, point));
                let towards = |point: usize| points[point] + 0.003 * view as f32 - of.camera.center;
                seen.map(|point| SweptPixel { direction: towards(point), near: 0.5, depth: Some(1.0) }).collect()
            })
            .collect();
        forget_unconfirmed(&fixture.views, &mut swept, 0.02);
        let left: Vec<Vec<bool>> =
            swept.iter().take(3).map(|pixels| pixels.iter().map(|pixel| pixel.depth.is_some()).collect()).collect();
        assert_eq!(left, [vec![true, false], vec![true, false], vec![true]]);
    }
}
