//! A ball or a stool on a table, seen from all around: masks are found, with the table's texture like the object's and without
//! any.

use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::{Camera, Cancellation, Mask, Split, View, stored};
use dvr_segmentation::{SegmentationError, Wanted, segment};
use dvr_stress::{Body, Coat, StillLife, Surroundings};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};

const RADIUS: f64 = 0.2;
const SIDE: u32 = 120;

/// Blotches: a value from 0 to 1 that changes from cell to cell.
fn blotch(at: DVec3, cell: f64) -> f64 {
    let [x, y, z] = (at / cell).floor().to_array().map(|c| c as i64 as u64);
    let mixed = (x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F))
        .wrapping_add(z.wrapping_mul(0x1656_67B1_9E37_79F9));
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64 / f64::from(1 << 24)
}

/// What a ray shows, and whether it is the ball.
fn shown(origin: DVec3, direction: DVec3, table: impl Fn(DVec3) -> [f64; 3]) -> ([f64; 3], bool) {
    let direction = direction.normalize();
    let along = -origin.dot(direction);
    let missed = (origin + along * direction).length_squared();
    if missed < RADIUS * RADIUS {
        let at = origin + (along - (RADIUS * RADIUS - missed).sqrt()) * direction;
        let value = blotch(at, 0.04);
        return ([0.5 + 0.4 * value, 0.3 + 0.3 * value, 0.2], true);
    }
    let at = origin + (-RADIUS - origin.z) / direction.z * direction;
    if direction.z < 0.0 && at.length() < 2.0 { (table(at), false) } else { ([0.05, 0.05, 0.08], false) }
}

/// Photographs from two rings, and the masks that are right.
fn scene(table: impl Fn(DVec3) -> [f64; 3] + Copy) -> (Vec<View>, Vec<Mask>) {
    let of_view = |i: u32| {
        let (turn, height) = (f64::from(i) / 24.0 * std::f64::consts::TAU, if i.is_multiple_of(2) { 0.5 } else { 0.9 });
        let eye = DVec3::new(1.2 * turn.cos(), 1.2 * turn.sin(), height);
        let camera = Camera::look_at(SIDE, SIDE, 1.6 * f64::from(SIDE), eye, DVec3::ZERO, DVec3::Z);
        let sample = |u: u32, v: u32| {
            let samples = (0..9).map(|k| {
                let place = DVec2::new(
                    f64::from(u) + f64::from(k % 3) / 3.0 + 1.0 / 6.0,
                    f64::from(v) + f64::from(k / 3) / 3.0 + 1.0 / 6.0,
                );
                let ray = camera.ray(place);
                shown(ray.origin, ray.direction, table)
            });
            samples.fold(([0.0; 3], 0), |(sum, count), (color, is_ball)| {
                (std::array::from_fn(|c| sum[c] + color[c] / 9.0), count + usize::from(is_ball))
            })
        };
        let picture = RgbImage::from_fn(SIDE, SIDE, |u, v| Rgb(sample(u, v).0.map(|c| (255.0 * c) as u8)));
        let mask =
            image::GrayImage::from_fn(SIDE, SIDE, |u, v| image::Luma([if sample(u, v).1 > 4 { 255 } else { 0 }]));
        let mut view = View::new(format!("{i:02}"), camera, stored(picture), None);
        view.split = if i % 8 == 3 { Split::Test } else { Split::Train };
        (view, Mask::from(mask))
    };
    (0..24).map(of_view).unzip()
}

/// Least overlap of a mask that was found with the one that is right.
fn least_overlap(found: &[Mask], right: &[Mask]) -> f64 {
    let overlap = |(found, right): (&Mask, &Mask)| {
        let (width, height) = right.size();
        let pixels = || (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
        let both = pixels().filter(|&(u, v)| found.is_object(u, v) && right.is_object(u, v)).count();
        let either = pixels().filter(|&(u, v)| found.is_object(u, v) || right.is_object(u, v)).count();
        both as f64 / either as f64
    };
    found.iter().zip(right).map(overlap).fold(1.0, f64::min)
}

/// Gives views for testing a picture that shows nothing of the scene.
fn repaint_tests(views: &mut [View]) {
    for view in views.iter_mut().filter(|view| view.split == Split::Test) {
        view.image = stored(RgbImage::from_pixel(SIDE, SIDE, Rgb([255, 0, 255])));
    }
}

/// Whether all views but those for testing have the same masks.
fn trained_alike(views: &[View], one: &[Mask], other: &[Mask]) -> bool {
    let mut masks = views.iter().zip(one.iter().zip(other)).filter(|(view, _)| view.split != Split::Test);
    masks.all(|(_, (one, other))| one == other)
}

#[test]
fn a_ball_is_told_from_a_table_with_blotches_of_its_own_colours_in_part() {
    let table = |at: DVec3| {
        let value = blotch(at + 7.0, 0.06);
        if blotch(at, 0.05) > 0.7 { [0.5 + 0.4 * value, 0.3 + 0.3 * value, 0.2] } else { [0.2, 0.3 + 0.4 * value, 0.6] }
    };
    let (mut views, right) = scene(table);
    let found = segment(&views, Wanted::Object, &Cancellation::default(), &|_, _| ()).unwrap();
    let plane = found.support.expect("the table is found");
    assert!(plane.normal.z > 0.999 && (plane.offset + RADIUS as f32).abs() < 0.01, "{plane:?}");
    // Object and background learned together agree with that, and have the outlines.
    assert!(found.is_learned);
    let worst = least_overlap(&found.masks, &right);
    assert!(worst > 0.95, "{worst}");
    // Views for testing have no say in that, nor in what is learned alone.
    repaint_tests(&mut views);
    let other = segment(&views, Wanted::Object, &Cancellation::default(), &|_, _| ()).unwrap();
    assert!(other.is_learned && trained_alike(&views, &found.masks, &other.masks));
    let learned = segment(&views, Wanted::Learned, &Cancellation::default(), &|_, _| ()).unwrap();
    let trained = views.iter().zip(learned.masks.iter().zip(&right)).filter(|(view, _)| view.split != Split::Test);
    let (learned_masks, right): (Vec<Mask>, Vec<Mask>) = trained.map(|(_, (a, b))| (a.clone(), b.clone())).unzip();
    let worst = least_overlap(&learned_masks, &right);
    assert!(learned.is_learned && worst > 0.95, "{worst}");
}

#[test]
fn a_ball_is_told_from_a_plain_table_by_its_colours_and_the_same_twice() {
    let (mut views, right) = scene(|_| [0.8, 0.8, 0.82]);
    let found = segment(&views, Wanted::Object, &Cancellation::default(), &|_, _| ()).unwrap();
    assert!(found.support.is_none(), "nothing of the table can be compared: {:?}", found.support);
    let worst = least_overlap(&found.masks, &right);
    assert!(worst > 0.9, "{worst}");
    let again = |views: &[View]| segment(views, Wanted::Object, &Cancellation::default(), &|_, _| ()).unwrap().masks;
    assert_eq!(again(&views), found.masks);
    // Views for testing have no say.
    repaint_tests(&mut views);
    assert!(trained_alike(&views, &found.masks, &again(&views)));
}

#[test]
fn plain_legs_before_a_cloth_are_found_where_the_wall_has_their_colour() {
    let (body, coat, surroundings) = (Body::Stool, Coat::Plain, Surroundings::Cloth);
    let stool = StillLife { body, coat, surroundings, views: 18, width: 200, samples: 2 };
    let folder = tempfile::tempdir().unwrap();
    stool.write(folder.path()).unwrap();
    let with_masks = |masks| read_scene(folder.path(), &ReadOptions { masks, ..ReadOptions::default() }).unwrap();
    let right = with_masks(Some(folder.path().join("truth/masks"))).views.into_iter().map(|view| view.mask.unwrap());
    let views = with_masks(None).views;
    let found = segment(&views, Wanted::Object, &Cancellation::default(), &|_, _| ()).unwrap();
    // From all views by colours alone, the legs are lost, and with them half of the object.
    assert!(found.is_learned);
    let worst = least_overlap(&found.masks, &right.collect::<Vec<_>>());
    assert!(worst > 0.85, "{worst}");
}

#[test]
fn too_few_views_are_refused_and_the_work_ends_when_it_is_wanted() {
    let (views, _) = scene(|_| [0.8, 0.8, 0.82]);
    let few = segment(&views[..3], Wanted::Object, &Cancellation::default(), &|_, _| ()).unwrap_err();
    assert_eq!(few, SegmentationError::TooFewViews { found: 3, least: 4 });
    let cancellation = Cancellation::default();
    cancellation.cancel();
    let ended = segment(&views, Wanted::Object, &cancellation, &|_, _| ()).unwrap_err();
    assert!(matches!(ended, SegmentationError::Cancelled(_)), "{ended}");
}
