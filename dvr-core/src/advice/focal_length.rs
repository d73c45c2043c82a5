//! Focal lengths that differ: zoom, or focus that was not locked, between pictures of one camera.

use std::collections::BTreeMap;

use super::finding::{Advice, Topic, ViewFigure, listed};
use crate::camera::Camera;
use crate::scene::Scene;

/// How far a focal length may be from the median, as a share: cameras that are found apart scatter by about a hundredth.
const CHANGE: f64 = 0.02;

/// Fewer pictures of a size have no median to go by.
const FEWEST: usize = 3;

/// Pictures whose focal length is not that of most of the same size (upright or not).
pub(super) fn advice(scene: &Scene) -> Option<Advice> {
    let mut sizes: BTreeMap<[u32; 2], Vec<(usize, f64)>> = BTreeMap::new();
    for (index, view) in scene.views.iter().enumerate() {
        let Camera { width, height, intrinsics, .. } = view.camera;
        let focal = (intrinsics.x_axis.x * intrinsics.y_axis.y).abs().sqrt();
        sizes.entry([width.min(height), width.max(height)]).or_default().push((index, focal));
    }
    let mut changed: Vec<(usize, f64, f64)> = Vec::new();
    for of_size in sizes.values().filter(|of_size| of_size.len() >= FEWEST) {
        let mut focals: Vec<f64> = of_size.iter().map(|(_, focal)| *focal).collect();
        focals.sort_by(f64::total_cmp);
        let median = focals[focals.len() / 2];
        let others = of_size.iter().map(|&(index, focal)| (index, focal, focal / median));
        changed.extend(others.filter(|(_, _, ratio)| (ratio - 1.0).abs() > CHANGE));
    }
    changed.sort_by(|a, b| (b.2 - 1.0).abs().total_cmp(&(a.2 - 1.0).abs()));
    if changed.is_empty() {
        return None;
    }
    let name = |index: usize| &scene.views[index].name;
    let each = |&(index, focal, ratio): &(usize, f64, f64)| {
        format!("`{}` ({focal:.0} pixels, {:+.1} %)", name(index), 100.0 * (ratio - 1.0))
    };
    let text = format!(
        "zoom or focus changed: the focal length is more than {:.0} % from the median of pictures of the same size in {}; \
         photograph all with one zoom and with focus locked",
        100.0 * CHANGE,
        listed(changed.iter().map(each))
    );
    let views = changed.iter().map(|&(index, _, figure)| ViewFigure { view: name(index).clone(), figure }).collect();
    Some(Advice { topic: Topic::FocalLength, views, threshold: CHANGE, text })
}

#[cfg(test)]
mod tests {
    use super::super::tests::scene_from;
    use super::*;

    #[test]
    fn pictures_with_another_focal_length_are_named() {
        let mut scene = scene_from(&[(0.0, 0.0), (20.0, 0.0), (40.0, 0.0), (60.0, 0.0), (80.0, 0.0)]);
        scene.views[1].camera.intrinsics.x_axis.x *= 1.01;
        assert_eq!(advice(&scene), None);
        for (view, factor) in [(3, 1.05), (4, 0.7)] {
            scene.views[view].camera.intrinsics.x_axis.x *= factor;
            scene.views[view].camera.intrinsics.y_axis.y *= factor;
        }
        let found = advice(&scene).expect("two of five differ");
        assert_eq!(found.views.iter().map(|view| view.view.as_str()).collect::<Vec<_>>(), ["4", "3"]);
        assert!(
            found.text.contains("`3`") && found.text.contains("+5.0 %") && found.text.contains("-30.0 %"),
            "{found}"
        );
    }
}
