//! Pictures that are blurred, by a lens out of focus or a camera that shook, against the other pictures of the scene.

use super::acuity::{self, Acuity, Ratios};
use super::finding::{Advice, Topic, ViewFigure, listed};
use super::orbit::Orbit;
use crate::cancellation::{Cancellation, Cancelled};
use crate::scene::Scene;

/// Sharpness, of that of the median picture, below which a picture is blurred: within the object and along its outline,
/// along one direction or more. Good photographs and renders have .36 and more. Copies of pictures of four scenes, blurred
/// by a Gaussian of 1.5 to 6 pixels or shaken by 7 to 13, have .01 to .17; where a shake of seven squares meets edges that
/// lie along it, .4 is left.
const BLURRED: f64 = 0.25;

/// The same of the inside alone, along all directions: where there is no mask, or the background was cut away, which
/// leaves outlines sharp. Only if nine of ten pictures have [`ALIKE`] there: sides of an object may be plain.
const BLURRED_INSIDE: f64 = 0.125;
const ALIKE: f64 = 0.35;

/// Fewer pictures have no median to go by.
const FEWEST: usize = 5;

/// Pictures that are blurred, most of all first.
pub(super) fn advice(scene: &Scene, orbit: &Orbit, cancellation: &Cancellation) -> Result<Option<Advice>, Cancelled> {
    let sharpness = sharpness(&acuity::of_views(scene, cancellation)?);
    let known = sharpness.iter().enumerate().filter_map(|(view, sharpness)| Some((view, (*sharpness)?)));
    let mut blurred: Vec<(usize, f64)> = known.filter(|(_, sharpness)| *sharpness < BLURRED).collect();
    blurred.sort_by(|a, b| a.1.total_cmp(&b.1));
    if blurred.is_empty() {
        return Ok(None);
    }
    let name = |view: usize| &scene.views[view].name;
    let each = |&(view, sharpness): &(usize, f64)| format!("`{}` ({sharpness:.2}, {})", name(view), orbit.sides[view]);
    let text = format!(
        "blurred, or shaken: the object is less than {BLURRED} times as sharp as in the median picture in {}; photograph these \
         again, in focus and with a steady camera, or leave them out",
        listed(blurred.iter().map(each))
    );
    let views = blurred.iter().map(|&(view, figure)| ViewFigure { view: name(view).clone(), figure }).collect();
    Ok(Some(Advice { topic: Topic::Blur, views, threshold: BLURRED, text }))
}

/// For each picture its sharpness, of that of the median picture; `None` where nothing tells.
fn sharpness(views: &[Acuity]) -> Vec<Option<f64>> {
    let inside = relative(views.iter().map(|view| view.inside));
    let outline = relative(views.iter().map(|view| view.outline));
    let best = |ratios: &Ratios| ratios.iter().copied().fold(0.0, f64::max);
    let mut insides: Vec<f64> = inside.iter().flatten().map(best).collect();
    insides.sort_by(f64::total_cmp);
    let are_alike = insides.get(insides.len() / 10).is_some_and(|tenth| *tenth >= ALIKE);
    let of_view = |(inside, outline): (&Option<Ratios>, &Option<Ratios>)| {
        let least = |ratios: Ratios| ratios.into_iter().fold(f64::INFINITY, f64::min);
        let both = match (inside, outline) {
            (Some(inside), Some(outline)) => Some(least(std::array::from_fn(|i| inside[i].max(outline[i])))),
            (None, Some(outline)) => Some(least(*outline)),
            _ => None,
        };
        let alone = inside.as_ref().filter(|_| are_alike).map(best).filter(|sharpness| *sharpness < BLURRED_INSIDE);
        both.into_iter().chain(alone).reduce(f64::min)
    };
    inside.iter().zip(&outline).map(of_view).collect()
}

/// Ratios over their medians, direction by direction.
fn relative(ratios: impl Iterator<Item = Option<Ratios>>) -> Vec<Option<Ratios>> {
    let mut ratios: Vec<Option<Ratios>> = ratios.collect();
    let known: Vec<Ratios> = ratios.iter().flatten().copied().collect();
    if known.len() < FEWEST {
        return vec![None; ratios.len()];
    }
    let median = |direction: usize| {
        let mut values: Vec<f64> = known.iter().map(|ratios| ratios[direction]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2].max(f64::MIN_POSITIVE)
    };
    let medians: Ratios = std::array::from_fn(median);
    for of_view in ratios.iter_mut().flatten() {
        *of_view = std::array::from_fn(|direction| of_view[direction] / medians[direction]);
    }
    ratios
}
