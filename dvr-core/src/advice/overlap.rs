//! Pictures that share too little with others: nothing confirms what they show.

use glam::DVec3;

use super::directions::even_directions;
use super::finding::{Advice, Topic, ViewFigure, listed};
use super::orbit::Orbit;
use crate::scene::{Scene, View};

/// Share of what a picture shows that two others must show each: depths count where two others confirm them. Neighbours
/// 72 degrees apart share less.
const SHARED: f64 = 0.6;

/// Others that must.
const OTHERS: usize = 2;

/// Places on the ellipsoid that stands for the object, and half its least axis, of its largest.
const PLACES: usize = 1024;
const THINNEST: f64 = 0.2;

/// Pictures that share too little of an ellipsoid in the object's place, seen by whoever is on its side, in the frame.
pub(super) fn advice(scene: &Scene, orbit: &Orbit) -> Option<Advice> {
    let seen: Vec<Vec<bool>> = scene.views.iter().map(|view| seen_places(scene, view)).collect();
    let lacking = |view: usize| {
        let mut shared: Vec<(f64, usize)> = (0..seen.len())
            .filter(|&other| other != view)
            .map(|other| (share(&seen[view], &seen[other]), other))
            .collect();
        shared.sort_by(|a, b| b.0.total_cmp(&a.0));
        let &(share, _) = shared.get(OTHERS - 1)?;
        (share < SHARED).then_some((view, share, shared[0].1))
    };
    let mut lacking: Vec<(usize, f64, usize)> = (0..seen.len()).filter_map(lacking).collect();
    lacking.sort_by(|a, b| a.1.total_cmp(&b.1));
    if lacking.is_empty() {
        return None;
    }
    let name = |view: usize| &scene.views[view].name;
    let each = |&(view, share, nearest): &(usize, f64, usize)| {
        format!("`{}` ({:.0} %, {}; beside it `{}`)", name(view), 100.0 * share, orbit.sides[view], name(nearest))
    };
    let text = format!(
        "too little overlap: two other pictures should each show {:.0} % of what a picture shows of the object, and do not of \
         {}; take pictures between these and the ones beside them",
        100.0 * SHARED,
        listed(lacking.iter().map(each))
    );
    let views = lacking.iter().map(|&(view, figure, _)| ViewFigure { view: name(view).clone(), figure }).collect();
    Some(Advice { topic: Topic::Overlap, views, threshold: SHARED, text })
}

/// Which places of the ellipsoid a view shows.
fn seen_places(scene: &Scene, view: &View) -> Vec<bool> {
    let bounds = scene.region.bounds;
    let half = 0.5 * bounds.size();
    let half = half.max(DVec3::splat(THINNEST * half.max_element()));
    let toward = (view.camera.center() - bounds.center()).normalize_or_zero();
    let is_seen = |direction: DVec3| {
        let (pixel, depth) = view.camera.project(bounds.center() + half * direction);
        (direction / half).dot(toward) > 0.0 && depth > 0.0 && view.camera.sees(pixel)
    };
    even_directions(PLACES).map(is_seen).collect()
}

/// The share of what one shows that the other shows too; 1 where it shows nothing.
fn share(one: &[bool], other: &[bool]) -> f64 {
    let shown = one.iter().filter(|seen| **seen).count();
    let both = one.iter().zip(other).filter(|(one, other)| **one && **other).count();
    if shown == 0 { 1.0 } else { both as f64 / shown as f64 }
}

#[cfg(test)]
mod tests {
    use super::super::tests::scene_from;
    use super::*;

    fn told(sides: &[(f64, f64)]) -> Option<Advice> {
        let scene = scene_from(sides);
        advice(&scene, &Orbit::of(&scene))
    }

    fn turn(count: u32) -> Vec<(f64, f64)> {
        (0..count).map(|i| (f64::from(i) * 360.0 / f64::from(count), 10.0)).collect()
    }

    #[test]
    fn six_pictures_around_an_object_share_enough_and_four_do_not() {
        assert_eq!(told(&turn(6)), None);
        let found = told(&turn(4)).expect("a quarter of a turn is too much");
        assert!(found.views.len() == 4 && found.views[0].figure < 0.53 && found.text.contains("60 %"), "{found}");
    }

    #[test]
    fn a_picture_far_from_all_others_is_named() {
        let mut sides: Vec<(f64, f64)> = (0..12).map(|i| (10.0 * f64::from(i), 0.0)).collect();
        sides.push((210.0, 5.0));
        let found = told(&sides).expect("it is 100 degrees from the next");
        let [alone] = &found.views[..] else { panic!("{found:?}") };
        assert!(alone.view == "12" && alone.figure < 0.45, "{found:?}");
        assert!(found.text.contains("`12`") && found.text.contains("azimuth 210"), "{found}");
    }

    #[test]
    fn close_pictures_of_different_parts_share_nothing() {
        let mut scene = scene_from(&turn(16));
        assert_eq!(advice(&scene, &Orbit::of(&scene)), None);
        // Each frame holds a part, and the next picture shows another.
        for (i, view) in scene.views.iter_mut().enumerate() {
            view.camera.intrinsics.x_axis.x *= 5.0;
            view.camera.intrinsics.y_axis.y *= 5.0;
            view.camera.intrinsics.z_axis.y += [-30.0, 30.0, 0.0][i % 3];
        }
        let found = advice(&scene, &Orbit::of(&scene)).expect("they hardly overlap");
        assert!(found.views.len() > 8, "{found:?}");
    }
}
