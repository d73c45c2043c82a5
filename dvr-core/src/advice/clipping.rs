//! Parts of the object that are burnt or black: they show nothing that could be compared.

use rayon::prelude::*;

use super::finding::{Advice, Topic, ViewFigure, listed};
use super::orbit::Orbit;
use crate::cancellation::{Cancellation, Cancelled};
use crate::exposure::Exposure;
use crate::scene::{Scene, View};

/// Share of the object's pixels by which a picture may have more of them than the scene's median picture: a white or
/// black object has them everywhere, and sides of an object may be white: of a chair's, .2.
const MORE: f64 = 0.25;

/// Share of the object's pixels in the median picture from which all are told of.
const MOST: f64 = 0.5;

/// Pictures in which much more of the object is burnt, or black, than in most; or that most are.
pub(super) fn advice(scene: &Scene, orbit: &Orbit, cancellation: &Cancellation) -> Result<Vec<Advice>, Cancelled> {
    let shares = scene.views.par_iter().map(|view| cancellation.check().map(|()| clipped_shares(view)));
    let shares: Vec<Option<[f64; 2]>> = shares.collect::<Result<_, _>>()?;
    let kinds = [(Topic::Burnt, 0), (Topic::Black, 1)];
    Ok(kinds.into_iter().filter_map(|(topic, kind)| of_kind(topic, &shares, kind, scene, orbit)).collect())
}

/// The shares of the object's pixels that are burnt and black in all channels; `None` where nothing tells them from a
/// white or black background, or there are none.
fn clipped_shares(view: &View) -> Option<[f64; 2]> {
    let coverage = view.training_mask()?.coverage.as_raw();
    // As [`Exposure::is_usable`], of all bytes.
    let usable: [bool; 256] = std::array::from_fn(|byte| Exposure::is_usable(byte as f32 / 255.0));
    let pixels = view.image.as_raw().as_chunks::<3>().0;
    let (mut object, mut clipped) = (0usize, [0usize; 2]);
    for (pixel, _) in pixels.iter().zip(coverage.iter()).filter(|(_, coverage)| **coverage >= 128) {
        object += 1;
        if pixel.iter().all(|&channel| !usable[usize::from(channel)]) {
            clipped[0] += usize::from(pixel.iter().all(|&channel| channel >= 128));
            clipped[1] += usize::from(pixel.iter().all(|&channel| channel < 128));
        }
    }
    (object > 0).then(|| clipped.map(|count| count as f64 / object as f64))
}

fn of_kind(topic: Topic, shares: &[Option<[f64; 2]>], kind: usize, scene: &Scene, orbit: &Orbit) -> Option<Advice> {
    let known = shares.iter().enumerate().filter_map(|(view, share)| Some((view, (*share)?[kind])));
    let mut known: Vec<(usize, f64)> = known.collect();
    known.sort_by(|a, b| b.1.total_cmp(&a.1));
    let &(_, median) = known.get(known.len() / 2)?;
    let (what, remedy) = match topic {
        Topic::Burnt => ("burnt (white in all channels)", "with a shorter exposure or softer light"),
        _ => ("black (dark in all channels)", "with a longer exposure or more light"),
    };
    let percent = |share: f64| 100.0 * share;
    let named = |views: &[(usize, f64)]| {
        views.iter().map(|&(view, figure)| ViewFigure { view: scene.views[view].name.clone(), figure }).collect()
    };
    if median > MOST {
        let text = format!(
            "{:.0} % of the object is {what} in the median picture (told from {:.0} % on): photograph all again {remedy}",
            percent(median),
            percent(MOST)
        );
        return Some(Advice { topic, views: named(&known), threshold: MOST, text });
    }
    let threshold = median + MORE;
    known.retain(|&(_, share)| share > threshold);
    if known.is_empty() {
        return None;
    }
    let each = |&(view, share): &(usize, f64)| {
        format!("`{}` ({:.0} %, {})", scene.views[view].name, percent(share), orbit.sides[view])
    };
    let text = format!(
        "parts of the object are {what}, more than {:.0} % of it (median picture {:.0} %), in {}; photograph these again \
         {remedy}",
        percent(threshold),
        percent(median),
        listed(known.iter().map(each))
    );
    Some(Advice { topic, views: named(&known), threshold, text })
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma, Rgb, RgbImage};

    use super::super::tests::scene_from;
    use super::*;
    use crate::pixels::stored;
    use crate::raster::Mask;

    /// Five views whose object, the left half, has these levels in its upper part; the background is burnt.
    fn found(levels: [u8; 5], rows: u32) -> Vec<Advice> {
        let mut scene = scene_from(&[(0.0, 0.0), (20.0, 0.0), (40.0, 0.0), (60.0, 0.0), (80.0, 0.0)]);
        for (view, level) in scene.views.iter_mut().zip(levels) {
            let (width, height) = view.image.dimensions();
            let part = |v: u32| if v < rows { level } else { 120 };
            let color = |u, v| Rgb(if u < width / 2 { [part(v); 3] } else { [255; 3] });
            view.image = stored(RgbImage::from_fn(width, height, color));
            view.mask =
                Some(Mask::from(GrayImage::from_fn(width, height, |u, _| Luma([if u < width / 2 { 255 } else { 0 }]))));
        }
        advice(&scene, &Orbit::of(&scene), &Cancellation::default()).unwrap()
    }

    #[test]
    fn pictures_with_burnt_or_black_parts_are_named_with_the_share() {
        assert_eq!(found([120, 30, 200, 248, 11], 32), []);
        assert_eq!(found([120, 255, 120, 0, 120], 7), [], "a highlight and a shadow");
        let both = found([120, 255, 120, 0, 120], 16);
        let [burnt, black] = &both[..] else { panic!("{both:?}") };
        assert_eq!((burnt.topic, black.topic), (Topic::Burnt, Topic::Black));
        assert_eq!(burnt.views, [ViewFigure { view: "1".into(), figure: 0.5 }]);
        assert_eq!(black.views, [ViewFigure { view: "3".into(), figure: 0.5 }]);
        assert!(burnt.text.contains("`1` (50 %, azimuth 20") && burnt.text.contains("shorter exposure"), "{burnt}");
    }

    #[test]
    fn a_black_object_is_no_fault_and_a_scene_without_light_is() {
        assert_eq!(found([0; 5], 14), []);
        let all = found([255; 5], 25);
        assert!(all.len() == 1 && all[0].views.len() == 5 && all[0].text.contains("78 %"), "{all:?}");
    }
}
