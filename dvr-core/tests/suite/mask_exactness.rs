//! Exact masks stay to the pixel, whatever the pictures show beside them; wrong ones are mended all the same.

use dvr_core::{
    Camera, Cancellation, GroundTruth, Mask, MaskSource, Region, Scene, Similarity, View, dataset, refine_masks, stored,
};
use glam::{DVec2, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage, Rgba, RgbaImage};

const SIZE: u32 = 64;

const RADIUS: f64 = 0.32;

/// Cameras all around.
fn cameras(count: usize) -> Vec<Camera> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let camera = |i: usize| {
        let y = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let eye = 1.6 * DVec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin);
        Camera::look_at(SIZE, SIZE, 1.2 * f64::from(SIZE), eye, DVec3::ZERO, DVec3::new(0.1, 1.0, 0.0))
    };
    (0..count).map(camera).collect()
}

/// The colour of a ball where a ray meets it, else the one where the ray passes nearest.
fn color(camera: &Camera, u: u32, v: u32) -> Rgb<u8> {
    let ray = camera.pixel_ray(u, v);
    let nearest = ray.at(-ray.origin.dot(ray.direction) / ray.direction.length_squared()).normalize();
    Rgb([150 + (60.0 * nearest.x.abs()) as u8, 60 + (40.0 * nearest.y.abs()) as u8, 30])
}

/// How much of each pixel a ball fills, from `0` to `255`, of 8x8 samples.
fn coverage(camera: &Camera) -> GrayImage {
    let is_hit = |u: f64, v: f64| {
        let ray = camera.ray(DVec2::new(u, v));
        ray.origin.cross(ray.direction.normalize()).length() < RADIUS
    };
    GrayImage::from_fn(SIZE, SIZE, |u, v| {
        let at =
            |i: u32, j: u32| (f64::from(u) + (f64::from(i) + 0.5) / 8.0, f64::from(v) + (f64::from(j) + 0.5) / 8.0);
        let hits = (0..64)
            .filter(|i| {
                let (x, y) = at(i % 8, i / 8);
                is_hit(x, y)
            })
            .count();
        Luma([(hits * 255 / 64) as u8])
    })
}

/// A view as programs render it with straight alpha: wherever there is any of the object its colour alone, else black.
fn straight(i: usize, camera: &Camera) -> View {
    let coverage = coverage(camera);
    let image = RgbImage::from_fn(SIZE, SIZE, |u, v| match coverage.get_pixel(u, v).0[0] {
        0 => Rgb([0; 3]),
        _ => color(camera, u, v),
    });
    View::new(i.to_string(), camera.clone(), stored(image), Mask::from(coverage))
}

fn scene(views: Vec<View>) -> Scene {
    Scene {
        name: "ball".into(),
        source: "ball".into(),
        format: "test",
        views,
        object_to_world: Similarity::default(),
        region: Region::default(),
        sparse_points: None,
        ground_truth: GroundTruth::default(),
        warnings: Vec::new(),
    }
}

/// Refines, and tells for each view how many pixels are given back and taken away.
fn changes(views: Vec<View>) -> Vec<(String, usize, usize)> {
    let report = refine_masks(&mut scene(views), &Cancellation::default()).unwrap();
    report.refined.into_iter().map(|view| (view.name, view.given_back, view.taken_away)).collect()
}

#[test]
fn a_soft_edge_is_believed_where_straight_alpha_shows_the_object_beyond_it() {
    let views = || cameras(8).iter().enumerate().map(|(i, camera)| straight(i, camera)).collect::<Vec<_>>();
    assert_eq!(changes(views()), []);
    // The same pictures with masks that are sure of the wrong: two pixels too tight.
    let mut tight = views();
    for view in &mut tight {
        let soft = view.mask.as_ref().unwrap().coverage.clone();
        let inside = |u: u32, v: u32| {
            (0..25).all(|i| {
                *soft.get_pixel((u + i % 5).saturating_sub(2).min(63), (v + i / 5).saturating_sub(2).min(63))
                    == Luma([255])
            })
        };
        let mask = GrayImage::from_fn(SIZE, SIZE, |u, v| Luma([if inside(u, v) { 255 } else { 0 }]));
        view.mask = Some(Mask::from(mask));
    }
    assert!(changes(tight).iter().filter(|(_, given_back, _)| *given_back > 100).count() == 8);
}

#[test]
fn what_one_mask_seems_to_lack_must_be_confirmed_by_the_others() {
    let mut views: Vec<View> = cameras(12).iter().enumerate().map(|(i, camera)| straight(i, camera)).collect();
    for view in &mut views {
        let binary = view.mask.as_ref().unwrap().coverage.pixels().map(|p| if p.0[0] >= 128 { 255 } else { 0 });
        let mask = GrayImage::from_raw(SIZE, SIZE, binary.collect()).unwrap();
        for (u, v, pixel) in mask.enumerate_pixels().filter(|(.., pixel)| pixel.0[0] == 0) {
            view.image.put_pixel(u, v, Rgb([250, 250, 250 - (pixel.0[0] + (u + v) as u8 % 5)]));
        }
        view.mask = Some(Mask::from(mask));
    }
    // In one picture something behind the object has its colours; in another the mask has a hole.
    let mask = views[3].mask.clone().unwrap();
    let left = (0..SIZE).find(|&u| mask.is_object(u, 32)).unwrap();
    let stripe = |u: u32, v: u32| (left.saturating_sub(4)..left).contains(&u) && (28..36).contains(&v);
    for (u, v) in (0..SIZE).flat_map(|u| (0..SIZE).map(move |v| (u, v))).filter(|&(u, v)| stripe(u, v)) {
        let color = color(&views[3].camera, u, v);
        views[3].image.put_pixel(u, v, color);
    }
    let hole = (28..33).flat_map(|u| (30..34).map(move |v| (u, v)));
    hole.for_each(|(u, v)| views[5].mask.as_mut().unwrap().coverage.put_pixel(u, v, Luma([0])));
    assert_eq!(changes(views.clone()), [("5".to_owned(), 20, 0)]);
    // The same stripe without witnesses is given back where it is all there is to see.
    assert!(changes(vec![views[3].clone()]).iter().any(|(_, given_back, _)| *given_back > 0));
}

#[test]
fn a_mask_file_that_repeats_the_alpha_channel_counts_as_alpha() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    ["images", "masks"].iter().for_each(|name| std::fs::create_dir(root.join(name)).unwrap());
    let mut frames = Vec::new();
    for (i, camera) in cameras(6).iter().enumerate() {
        let view = straight(i, camera);
        let alpha = &view.mask.as_ref().unwrap().coverage;
        let rgba = RgbaImage::from_fn(SIZE, SIZE, |u, v| {
            let [r, g, b] = view.image.get_pixel(u, v).0;
            Rgba([r, g, b, alpha.get_pixel(u, v).0[0]])
        });
        rgba.save(root.join(format!("images/{i}.png"))).unwrap();
        // The first mask has another opinion.
        let mask = GrayImage::from_fn(SIZE, SIZE, |u, v| {
            let is_object = alpha.get_pixel(u, v).0[0] >= 128 && !(i == 0 && (u, v) == (32, 32));
            Luma([if is_object { 255 } else { 0 }])
        });
        mask.save(root.join(format!("masks/{i}.png"))).unwrap();
        let (rotation, center) = (camera.rotation.transpose(), camera.center());
        let row = |r: usize| [rotation.row(r).x, -rotation.row(r).y, -rotation.row(r).z, center[r]];
        let matrix = [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        frames.push(serde_json::json!({
            "file_path": format!("images/{i}.png"), "mask_path": format!("masks/{i}.png"), "transform_matrix": matrix
        }));
    }
    let focal = 1.2 * f64::from(SIZE);
    let json = serde_json::json!({ "fl_x": focal, "w": SIZE, "h": SIZE, "frames": frames });
    std::fs::write(root.join("transforms.json"), json.to_string()).unwrap();
    let scene = dataset::read_scene(root, &dataset::ReadOptions::default()).unwrap();
    let sources: Vec<MaskSource> = scene.views.iter().map(|view| view.mask_source).collect();
    assert_eq!(sources[0], MaskSource::File);
    assert!(sources[1..].iter().all(|source| *source == MaskSource::Alpha), "{sources:?}");
}
