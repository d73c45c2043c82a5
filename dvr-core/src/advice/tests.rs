//! Copies of a good scene, made bad on purpose: each fault is found and named, and the scene itself is not blamed.

use glam::DVec3;
use image::RgbImage;

use super::*;
use crate::camera::{Camera, Similarity};
use crate::pixels::stored;
use crate::region::Region;
use crate::scene::{GroundTruth, View};

/// Black views of 32x32 pixels from these azimuths and elevations.
pub(super) fn scene_from(sides: &[(f64, f64)]) -> Scene {
    let view = |(i, &(azimuth, elevation)): (usize, &(f64, f64))| {
        let (a, e) = (azimuth.to_radians(), elevation.to_radians());
        let eye = 2.0 * DVec3::new(e.cos() * a.cos(), e.sin(), -e.cos() * a.sin());
        let camera = Camera::look_at(32, 32, 40.0, eye, DVec3::ZERO, DVec3::Y);
        View::new(i.to_string(), camera, stored(RgbImage::new(32, 32)), None)
    };
    Scene {
        name: String::new(),
        source: std::path::PathBuf::new(),
        format: "",
        views: sides.iter().enumerate().map(view).collect(),
        object_to_world: Similarity::default(),
        region: Region::default(),
        sparse_points: None,
        ground_truth: GroundTruth::default(),
        warnings: Vec::new(),
    }
}

fn demo_scene() -> Scene {
    Scene::read(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/mug/mug")).unwrap()
}

fn told(scene: &Scene) -> Vec<Advice> {
    scene.advice(&Cancellation::default()).unwrap()
}

/// The one piece of advice, which must be about this and name these views, in any order.
fn names(scene: &Scene, topic: Topic, views: &[usize]) -> Advice {
    let found = told(scene);
    let [advice] = &found[..] else { panic!("{found:?}") };
    assert_eq!(advice.topic, topic, "{advice}");
    let mut named: Vec<&str> = advice.views.iter().map(|view| view.view.as_str()).collect();
    named.sort_unstable();
    assert_eq!(named, views.iter().map(|&view| scene.views[view].name.as_str()).collect::<Vec<_>>(), "{advice}");
    advice.clone()
}

fn change(view: &mut View, change: impl Fn(RgbImage) -> RgbImage) {
    let (width, height) = view.image.dimensions();
    let picture = RgbImage::from_raw(width, height, view.image.as_raw().to_vec()).unwrap();
    view.image = stored(change(picture));
}

fn blurred(sigma: f32) -> impl Fn(RgbImage) -> RgbImage {
    move |picture| image::imageops::blur(&picture, sigma)
}

/// As by a camera that moved by so many pixels along the diagonal.
fn shaken(pixels: u32) -> impl Fn(RgbImage) -> RgbImage {
    move |picture| {
        let (width, height) = picture.dimensions();
        RgbImage::from_fn(width, height, |u, v| {
            let along = (0..pixels).map(|i| picture.get_pixel((u + i).min(width - 1), (v + i).min(height - 1)).0);
            let sum = along.fold([0; 3], |sum: [u32; 3], color| [0, 1, 2].map(|c| sum[c] + u32::from(color[c])));
            image::Rgb(sum.map(|sum| (sum / pixels) as u8))
        })
    }
}

/// With so many times the level of each channel.
fn exposed(factor: f32) -> impl Fn(RgbImage) -> RgbImage {
    move |mut picture| {
        picture.iter_mut().for_each(|level| *level = (f32::from(*level) * factor).min(255.0) as u8);
        picture
    }
}

#[test]
fn the_demo_scene_is_not_blamed() {
    assert_eq!(told(&demo_scene()), []);
}

#[test]
fn blurred_and_shaken_pictures_are_named_whatever_they_show() {
    let mut scene = demo_scene();
    for (view, sigma) in [(2, 1.5), (9, 2.0), (15, 4.0), (26, 8.0)] {
        change(&mut scene.views[view], blurred(sigma));
    }
    change(&mut scene.views[20], shaken(7));
    let advice = names(&scene, Topic::Blur, &[2, 9, 15, 20, 26]);
    assert!(advice.views.iter().all(|view| view.figure < 0.25), "{advice:?}");
    assert!(advice.text.contains("azimuth") && advice.text.contains("again"), "{advice}");
}

#[test]
fn a_blurred_background_is_no_blurred_object_and_neither_is_a_darker_picture() {
    let mut scene = demo_scene();
    let mask = scene.views[7].mask.clone().unwrap();
    change(&mut scene.views[7], |picture| {
        let far = image::imageops::blur(&picture, 3.0);
        RgbImage::from_fn(128, 128, |u, v| *(if mask.is_object(u, v) { &picture } else { &far }).get_pixel(u, v))
    });
    change(&mut scene.views[12], exposed(0.3));
    assert_eq!(told(&scene), []);
}

#[test]
fn without_masks_blur_is_found_where_the_object_has_texture() {
    let mut scene = demo_scene();
    scene.views.iter_mut().for_each(|view| view.mask = None);
    assert_eq!(told(&scene), []);
    [5, 18].into_iter().for_each(|view| change(&mut scene.views[view], blurred(3.0)));
    names(&scene, Topic::Blur, &[5, 18]);
}

#[test]
fn burnt_and_black_pictures_are_named() {
    let mut scene = demo_scene();
    change(&mut scene.views[4], exposed(3.0));
    let advice = names(&scene, Topic::Burnt, &[4]);
    assert!(advice.views[0].figure > 0.3, "{advice}");
    let mut scene = demo_scene();
    [3, 17].into_iter().for_each(|view| change(&mut scene.views[view], exposed(0.04)));
    let advice = told(&scene).into_iter().find(|advice| advice.topic == Topic::Black).expect("two are black");
    assert_eq!(advice.views.len(), 2, "{advice}");
}

#[test]
fn a_side_whose_pictures_were_taken_away_is_told() {
    let mut scene = demo_scene();
    let side = DVec3::new(0.8, 0.1, 0.6).normalize();
    scene.views.retain(|view| view.camera.center().normalize().dot(side) < 66f64.to_radians().cos());
    assert!(scene.views.len() > 15, "{}", scene.views.len());
    let found = told(&scene);
    let orbit = Orbit::of(&scene);
    let gap = found.iter().find(|advice| advice.topic == Topic::Gap).unwrap_or_else(|| panic!("{found:?}"));
    assert!(gap.views[0].figure > 25.0 && gap.text.contains("photograph"), "{gap}");
    println!("{gap}; it was {}", orbit.side(side));
}

#[test]
fn few_pictures_have_too_little_overlap() {
    let mut scene = demo_scene();
    let mut index = 0;
    scene.views.retain(|_| {
        index += 1;
        index % 6 == 1
    });
    let found = told(&scene);
    let overlap = found.iter().find(|advice| advice.topic == Topic::Overlap).unwrap_or_else(|| panic!("{found:?}"));
    assert!(overlap.views.len() > 2 && overlap.views[0].figure < 0.6, "{overlap}");
}

#[test]
fn it_ends_when_nobody_wants_it() {
    let cancellation = Cancellation::default();
    cancellation.cancel();
    assert!(demo_scene().advice(&cancellation).is_err());
}

#[test]
fn scenes_of_no_pictures_and_of_one_are_told_nothing() {
    assert_eq!(told(&scene_from(&[])), []);
    assert_eq!(told(&scene_from(&[(0.0, 90.0)])), []);
}
