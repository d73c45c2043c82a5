//! A relief on a wall that goes on beyond all pictures: masks show what lies in one cube.

use dvr_core::{Camera, Cancellation, View, stored};
use dvr_segmentation::{Shown, Wanted, segment};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};

const SIDE: u32 = 120;

/// A value from 0 to 1 that changes from cell to cell.
fn blotch(at: DVec2, cell: f64) -> f64 {
    let [x, y] = (at / cell).floor().to_array().map(|c| c as i64 as u64);
    let mixed = x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64 / f64::from(1 << 24)
}

/// How far the wall stands out: waves, all over.
fn relief(at: DVec2) -> f64 {
    0.07 * ((5.0 * at.x).sin() + (4.0 * at.y).cos())
}

/// Where a ray meets the wall.
fn met(origin: DVec3, direction: DVec3) -> DVec3 {
    let step = 0.004;
    let mut points = (0..2000).map(|i| origin + f64::from(i) * step * direction);
    points.find(|point| point.z < relief(point.truncate())).unwrap_or(DVec3::splat(9.0))
}

/// Photographs from the side that can be seen.
fn views() -> Vec<View> {
    let of_view = |i: u32| {
        let [across, up] = [i % 4, i / 4].map(|k| (f64::from(k) - 1.5) * 0.35);
        let eye = 1.5 * DVec3::new(across, up, 1.0).normalize();
        let camera = Camera::look_at(SIDE, SIDE, 0.9 * f64::from(SIDE), eye, DVec3::ZERO, DVec3::Y);
        let picture = RgbImage::from_fn(SIDE, SIDE, |u, v| {
            let samples = (0..4).map(|k| {
                let place = DVec2::new(
                    f64::from(u) + 0.25 + 0.5 * f64::from(k % 2),
                    f64::from(v) + 0.25 + 0.5 * f64::from(k / 2),
                );
                let ray = camera.ray(place);
                let at = met(ray.origin, ray.direction.normalize()).truncate();
                0.5 * blotch(at, 0.05) + 0.5 * blotch(at + 3.0, 0.023)
            });
            let value = (50.0 * samples.sum::<f64>()) as u8;
            Rgb([value + 20, value, value / 2])
        });
        View::new(format!("{i:02}"), camera, stored(picture), None)
    };
    (0..16).map(of_view).collect()
}

#[test]
fn masks_of_a_wall_show_the_same_part_of_it() {
    let views = views();
    let furthest = std::sync::Mutex::new((0, 0));
    let found = segment(&views, Wanted::Cube, &Cancellation::default(), &|done, parts| {
        let mut furthest = furthest.lock().unwrap();
        *furthest = (furthest.0.max(done), parts);
    });
    let found = found.unwrap();
    assert_eq!((found.shown, found.support), (Shown::Cube, None));
    let (furthest, parts) = furthest.into_inner().unwrap();
    assert_eq!(furthest, parts, "the work is told to its end");

    // Places on the wall are in all masks that could show them, or in none, but for those at the cube's faces.
    let (mut inside, mut outside, mut between) = (0, 0, 0);
    for i in 0..41 * 41 {
        let at = 0.04 * DVec2::new(f64::from(i % 41 - 20), f64::from(i / 41 - 20));
        let point = at.extend(relief(at));
        let shown: Vec<bool> = views
            .iter()
            .zip(&found.masks)
            .filter_map(|(view, mask)| {
                let (pixel, z) = view.camera.project(point);
                let is_hidden =
                    (met(view.camera.center(), (point - view.camera.center()).normalize()) - point).length() > 0.03;
                (z > 0.0 && view.camera.sees(pixel) && !is_hidden)
                    .then(|| mask.is_object(pixel.x as u32, pixel.y as u32))
            })
            .collect();
        if shown.len() >= 5 {
            let share = shown.iter().filter(|shown| **shown).count() as f64 / shown.len() as f64;
            *(if share > 0.8 {
                &mut inside
            } else if share < 0.2 {
                &mut outside
            } else {
                &mut between
            }) += 1;
        }
    }
    assert!(inside > 200 && outside > 50, "{inside} {outside}");
    assert!(f64::from(between) < 0.1 * f64::from(inside + outside), "{between} of {}", inside + outside);
}
