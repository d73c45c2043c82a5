//! Scenes whose lenses distort: what is read is what pinholes would have seen.

use glam::DQuat;

use super::*;
use crate::lens::Lens;

/// The terms of the lens behind its focal lengths and principal point, as OPENCV has them: k1, k2, p1, p2.
const TERMS: [f64; 4] = [-0.35, 0.2, 0.01, -0.02];

/// A ball before lenses of one kind.
struct Distorted {
    ball: Ball,
}

impl Distorted {
    fn lens(camera: &Camera) -> Lens {
        let k = camera.intrinsics;
        let parameters = [&[k.x_axis.x, k.y_axis.y, k.z_axis.x, k.z_axis.y][..], &TERMS].concat();
        Lens::from_colmap("OPENCV", WIDTH, HEIGHT, &parameters).unwrap()
    }

    /// Pictures in `images/` and masks in `masks/`.
    fn write_pictures(&self, root: &Path) -> Vec<String> {
        for folder in ["images", "masks"] {
            std::fs::create_dir_all(root.join(folder)).unwrap();
        }
        let names: Vec<String> = (0..self.ball.cameras.len()).map(|i| format!("{i:04}.png")).collect();
        for (camera, name) in self.ball.cameras.iter().zip(&names) {
            let lens = Self::lens(camera);
            let shows_ball = |u: u32, v: u32| {
                let direction = lens.direction_of(DVec2::new(u.into(), v.into()) + 0.5).unwrap();
                let pixel = (camera.intrinsics * direction.extend(1.0)).truncate();
                self.ball.z_depth(camera, pixel).is_some()
            };
            let picture = RgbImage::from_fn(WIDTH, HEIGHT, |u, v| Rgb([if shows_ball(u, v) { 40 } else { 250 }; 3]));
            let mask = GrayImage::from_fn(WIDTH, HEIGHT, |u, v| Luma([if shows_ball(u, v) { 255 } else { 0 }]));
            write_rgb_png(&root.join("images").join(name), &picture).unwrap();
            write_gray_png(&root.join("masks").join(name), &mask).unwrap();
        }
        names
    }

    /// What was read shows the ball where pinholes would, in pictures and masks.
    fn assert_undone(&self, scene: &Scene) {
        let world_to_object = scene.object_to_world.inverse();
        let (center, radius) =
            (world_to_object.transform_point(self.ball.center), self.ball.radius / scene.object_to_world.scale);
        for view in &scene.views {
            let (mask, image) = (view.mask.as_ref().unwrap(), &view.image);
            assert_eq!((mask.size(), image.dimensions()), ((view.camera.width, view.camera.height), mask.size()));
            let (mut both, mut either, mut differ) = (0, 0, 0);
            for (u, v, pixel) in image.enumerate_pixels() {
                let ray = view.camera.pixel_ray(u, v);
                let to = ray.origin - center;
                let along = to.dot(ray.direction) / ray.direction.length_squared();
                let hit = (to - along * ray.direction).length() < radius;
                // They are interpolated differently, which shows along the outline.
                differ += u32::from(mask.is_object(u, v) != (pixel.0[0] < 145));
                both += u32::from(hit && mask.is_object(u, v));
                either += u32::from(hit || mask.is_object(u, v));
            }
            assert!(differ < 20, "{}: mask and picture differ in {differ} pixels", view.name);
            assert!(f64::from(both) > 0.95 * f64::from(either), "{}: {both} of {either}", view.name);
        }
    }
}

#[test]
fn a_distorted_colmap_model_is_undistorted_as_it_is_read() {
    let (distorted, folder) = (Distorted { ball: Ball::new() }, tempfile::tempdir().unwrap());
    let root = folder.path();
    let names = distorted.write_pictures(root);
    let (mut cameras, mut images) = (String::new(), String::new());
    // The ball's middle, which is not on its surface: a point like another as far as its bearings are concerned.
    let point = distorted.ball.center;
    let mut points = format!("7 {} {} {} 1 2 3 0.5", point.x, point.y, point.z);
    for (i, (camera, name)) in distorted.ball.cameras.iter().zip(names).enumerate() {
        let (k, q, t) = (camera.intrinsics, DQuat::from_mat3(&camera.rotation), camera.translation);
        let [k1, k2, p1, p2] = TERMS;
        let (fx, fy, cx, cy) = (k.x_axis.x, k.y_axis.y, k.z_axis.x, k.z_axis.y);
        cameras += &format!("{i} OPENCV {WIDTH} {HEIGHT} {fx} {fy} {cx} {cy} {k1} {k2} {p1} {p2}\n");
        let p = camera.rotation * point + t;
        let pixel = Distorted::lens(camera).pixel_of(DVec2::new(p.x, p.y) / p.z).unwrap();
        images += &format!(
            "{i} {} {} {} {} {} {} {} {i} {name}\n{} {} 7\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z, pixel.x, pixel.y
        );
        points += &format!(" {i} 0");
    }
    let model = root.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    for (name, text) in [("cameras", cameras), ("images", images), ("points3D", points)] {
        std::fs::write(model.join(format!("{name}.txt")), text).unwrap();
    }
    let scene = read(root);
    distorted.assert_undone(&scene);
    let sparse = scene.sparse_points.unwrap();
    for (&view, bearing) in sparse.visible_in[0].iter().zip(&sparse.bearings.unwrap()[0]) {
        let camera = &distorted.ball.cameras[view];
        let p = camera.rotation * point + camera.translation;
        assert!((*bearing - DVec2::new(p.x, p.y) / p.z).length() < 1e-6, "{bearing}");
    }
    // A pixel of a file is found in the view that was made of it, at any size.
    for downscale in [1, 2] {
        let options = ReadOptions { downscale, ..ReadOptions::default() };
        let scene = read_scene(root, &options).unwrap();
        for (camera, view) in distorted.ball.cameras.iter().zip(&scene.views) {
            let p = camera.rotation * point + camera.translation;
            let pixel = Distorted::lens(camera).pixel_of(DVec2::new(p.x, p.y) / p.z).unwrap();
            let expected = view.camera.project(scene.object_to_world.inverse().transform_point(point)).0;
            for picture in [view.name.clone(), format!("{}.png", view.name)] {
                let found = places_in_view(root, &options, &picture, &[pixel]).unwrap();
                assert_eq!(found.view, view.name);
                assert!(found.places[0].distance(expected) < 1e-4, "{} {expected}", found.places[0]);
            }
        }
    }
    let refused = |picture: &str, pixel: DVec2| {
        places_in_view(root, &ReadOptions::default(), picture, &[pixel]).unwrap_err().to_string()
    };
    let outside = refused("0001.png", DVec2::new(f64::from(WIDTH) + 0.5, 3.5));
    let parts = ["0001.png", &format!("pixel ({WIDTH}, 3)"), &format!("{WIDTH}x{HEIGHT}")];
    assert!(parts.iter().all(|part| outside.contains(*part)), "{outside}");
    assert!(refused("0100", DVec2::ONE).contains("0100"));
}

#[test]
fn distortion_in_transforms_is_undone_too() {
    let (distorted, folder) = (Distorted { ball: Ball::new() }, tempfile::tempdir().unwrap());
    let names = distorted.write_pictures(folder.path());
    let frame = |(camera, name): (&Camera, &String)| {
        let mut frame = distorted.ball.frame(camera, &format!("images/{name}"));
        for (key, term) in ["k1", "k2", "p1", "p2"].iter().zip(TERMS) {
            frame[key] = term.into();
        }
        frame
    };
    let frames: Vec<_> = distorted.ball.cameras.iter().zip(&names).map(frame).collect();
    let json = serde_json::json!({ "camera_model": "OPENCV", "frames": frames });
    std::fs::write(folder.path().join("transforms.json"), json.to_string()).unwrap();
    distorted.assert_undone(&read(folder.path()));
}
