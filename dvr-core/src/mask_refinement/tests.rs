//! Masks with known mistakes.

use glam::DVec3;
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::*;
use crate::camera::{Camera, Similarity};
use crate::scene::GroundTruth;

const SIZE: u32 = 60;

const WHITE: Rgb<u8> = Rgb([255; 3]);

fn square(u: u32, v: u32) -> bool {
    (10..50).contains(&u) && (10..50).contains(&v)
}

/// A patterned square of 40 pixels on a background. The mask leaves out what `missing` says; the picture is `shown`
/// there, where that is given.
fn view(missing: impl Fn(u32, u32) -> bool, shown: Option<Rgb<u8>>, background: Rgb<u8>) -> View {
    let image = RgbImage::from_fn(SIZE, SIZE, |u, v| match shown {
        Some(color) if missing(u, v) => color,
        _ if square(u, v) => Rgb([150 + (u * 7 + v * 3) as u8 % 60, 40 + (v * 5) as u8 % 40, 30]),
        _ => background,
    });
    let coverage = |u, v| Luma([if square(u, v) && !missing(u, v) { 255 } else { 0 }]);
    let camera = Camera::look_at(SIZE, SIZE, 60.0, DVec3::Z, DVec3::ZERO, DVec3::Y);
    let (image, mask) = (stored(image), Mask::from(GrayImage::from_fn(SIZE, SIZE, coverage)));
    View::new("0", camera, image, mask)
}

/// A disc of 29 pixels.
fn disc(u: u32, v: u32, (x, y): (u32, u32)) -> bool {
    u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2) <= 9
}

fn is_whole(mask: &Mask) -> bool {
    (0..SIZE).all(|v| (0..SIZE).all(|u| mask.is_object(u, v) == square(u, v)))
}

/// How many pixels are missing, and belong to a rim.
fn counts(view: &View) -> [usize; 2] {
    let mistakes = mistakes_of_view(view).unwrap();
    [mistakes.missing.len(), mistakes.rim.len()]
}

#[test]
fn what_shows_the_object_is_given_back() {
    let hole = |u: u32, v: u32| disc(u, v, (30, 25));
    let bite = |u: u32, v: u32| disc(u, v, (12, 25));
    let tight = |u: u32, v: u32| !((11..49).contains(&u) && (11..49).contains(&v));
    let loose = |u: u32, v: u32| !((14..46).contains(&u) && (14..46).contains(&v));
    let speck = |u: u32, v: u32| (u, v) == (30, 30);
    type Missing<'a> = &'a dyn Fn(u32, u32) -> bool;
    let missing: [(Missing, usize); 5] = [(&hole, 29), (&bite, 28), (&tight, 156), (&loose, 576), (&speck, 1)];
    for (i, (missing, count)) in missing.into_iter().enumerate() {
        let mut view = view(missing, None, WHITE);
        assert_eq!(counts(&view), [count, 0], "{i}");
        view.mask = corrected(view.mask.as_ref().unwrap(), &mistakes_of_view(&view).unwrap());
        assert!(is_whole(view.mask.as_ref().unwrap()), "{i}");
        assert_eq!(counts(&view), [0, 0], "{i}, again");
    }
}

#[test]
fn what_shows_the_background_or_cannot_be_told_stays() {
    let hole = |u: u32, v: u32| disc(u, v, (30, 25));
    // A true hole; one with a shade of the background, as a shadow or an unsharp edge makes it; an object that looks like
    // its background.
    for (shown, background) in [(Some(WHITE), WHITE), (Some(Rgb([225, 200, 200])), WHITE), (None, Rgb([170, 60, 30]))] {
        assert_eq!(counts(&view(hole, shown, background)), [0, 0], "{shown:?} {background:?}");
    }
    // A hole that looks like the object at its edge alone.
    let mut shaded = view(hole, None, WHITE);
    (0..SIZE).flat_map(|u| (0..SIZE).map(move |v| (u, v))).filter(|&(u, v)| u > 28 && hole(u, v)).for_each(|(u, v)| {
        shaded.image.put_pixel(u, v, WHITE);
    });
    assert_eq!(counts(&shaded), [0, 0]);
    // Some pixels on the outline, more of the object than of the background.
    let mixed = |u: u32, v: u32| u == 10 && (20..28).contains(&v);
    assert_eq!(counts(&view(mixed, Some(Rgb([180, 110, 100])), WHITE)), [0, 0]);
    // Most of the object, and all of it.
    let most = |u: u32, v: u32| (14..46).contains(&u) && (14..46).contains(&v);
    assert_eq!(counts(&view(most, None, WHITE)), [0, 0]);
    assert_eq!(counts(&view(|_, _| true, None, WHITE)), [0, 0]);
}

/// A view whose mask is `rim` pixels too wide.
fn wide(rim: u32, background: Rgb<u8>) -> View {
    let mut view = view(|_, _| false, None, background);
    let reach = 10 - rim..50 + rim;
    let pixels = view.mask.as_mut().unwrap().coverage.enumerate_pixels_mut();
    pixels.filter(|(u, v, _)| reach.contains(u) && reach.contains(v)).for_each(|(_, _, pixel)| pixel.0[0] = 255);
    view
}

#[test]
fn a_rim_of_background_is_found_where_it_goes_around() {
    for rim in [1, 2, 4] {
        assert_eq!(counts(&wide(rim, WHITE)), [0, ((40 + 2 * rim).pow(2) - 1600) as usize]);
    }
    // White at one side of the object, on white.
    let mut highlight = view(|_, _| false, None, WHITE);
    for (u, v) in (20..40).flat_map(|u| (10..16).map(move |v| (u, v))) {
        highlight.image.put_pixel(u, v, WHITE);
    }
    assert_eq!(counts(&highlight), [0, 0]);
}

#[test]
fn rims_are_taken_away_where_half_of_the_masks_have_one() {
    for (wide_ones, all, is_taken) in [(1, 3, false), (2, 3, true), (0, 3, false)] {
        let views = (0..all).map(|i| if i < wide_ones { wide(2, WHITE) } else { wide(0, WHITE) });
        let mut scene = scene(views.collect());
        let report = refine_masks(&mut scene, &Cancellation::default()).unwrap();
        let refined = if is_taken { wide_ones } else { 0 };
        assert_eq!((report.looked_at, report.refined.len(), report.notes().len()), (all, refined, refined.min(1)));
        assert_eq!(scene.views.iter().filter(|view| view.refined_mask.is_some()).count(), refined);
        let whole = scene.views.iter().filter(|view| is_whole(view.training_mask().unwrap())).count();
        assert_eq!(whole, if is_taken { all } else { all - wide_ones });
    }
}

#[test]
fn masks_as_given_stay_and_only_files_of_views_for_training_and_validation_are_refined() {
    let holed = || view(|u, v| disc(u, v, (30, 25)), None, WHITE);
    let mut views = vec![holed(), holed(), holed(), holed(), holed(), holed()];
    views[1].split = Split::Val;
    views[2].split = Split::Test;
    views[3].mask_source = MaskSource::Alpha;
    views[4].mask_source = MaskSource::Background;
    views[5].mask = None;
    views.iter_mut().enumerate().for_each(|(i, view)| view.name = i.to_string());
    let mut scene = scene(views);
    let report = refine_masks(&mut scene, &Cancellation::default()).unwrap();
    let refined = |name: &str| RefinedView { name: name.into(), given_back: 29, taken_away: 0 };
    assert_eq!(report, MaskReport { looked_at: 2, refined: vec![refined("0"), refined("1")] });
    assert!(report.to_string().starts_with("2 of 2 masks leave out"), "{report}");
    assert!(scene.views[..5].iter().all(|view| view.mask == holed().mask));
    let before = scene.views[0].refined_mask.clone();
    assert_eq!(refine_masks(&mut scene, &Cancellation::default()).unwrap(), report, "again");
    assert_eq!(scene.views[0].refined_mask, before);
    assert_eq!(scene.require_masks().unwrap_err().to_string().split('.').next(), Some("view `5` has no mask"));
}

fn scene(views: Vec<View>) -> Scene {
    Scene {
        name: "squares".into(),
        source: "squares".into(),
        format: "test",
        views,
        object_to_world: Similarity::default(),
        region: crate::region::Region::default(),
        sparse_points: None,
        ground_truth: GroundTruth::default(),
        warnings: Vec::new(),
    }
}
