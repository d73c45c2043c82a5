//! What the options do.

use super::*;
use crate::cancellation::Cancellation;
use crate::mask_refinement::refine_masks;
use crate::pixels::PixelStore;
use crate::scene::{Split, View};

fn dvr() -> (Ball, tempfile::TempDir) {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_dvr(folder.path());
    (ball, folder)
}

fn names(scene: &Scene) -> Vec<&str> {
    scene.views.iter().map(|view| view.name.as_str()).collect()
}

#[test]
fn formats_and_backgrounds_go_by_their_names() {
    for format in Format::all() {
        assert_eq!(format.to_string().parse::<Format>().unwrap(), format);
    }
    assert_eq!("NeuS".parse::<Format>().unwrap(), "idr".parse().unwrap());
    let error = "obj".parse::<Format>().unwrap_err().to_string();
    assert!(error.contains("`obj`") && error.contains("colmap"), "{error}");
    assert_eq!("border".parse::<BackgroundColor>().unwrap(), BackgroundColor::Border);
    assert!("blue".parse::<BackgroundColor>().is_err());
}

#[test]
fn options_survive_a_file() {
    let options = ReadOptions {
        format: Some("colmap".parse().unwrap()),
        background: Some(Background::of(BackgroundColor::Black)),
        normalise: Normalise::Given(Similarity { scale: 3.0, ..Similarity::default() }),
        max_memory: Some(2_000_000_000),
        ..ReadOptions::default()
    };
    let json = serde_json::to_string(&options).unwrap();
    assert_eq!(serde_json::from_str::<ReadOptions>(&json).unwrap(), options);
    assert_eq!(serde_json::from_str::<ReadOptions>("{}").unwrap(), ReadOptions::default());
}

#[test]
fn pixels_beyond_the_memory_that_is_allowed_lie_in_a_scratch_file_and_read_the_same() {
    let (_, folder) = dvr();
    let in_memory = read(folder.path());
    let view_bytes = u64::from(4 * WIDTH * HEIGHT);
    for (max_memory, expected) in [(0, 0), (view_bytes - 1, 0), (2 * view_bytes + 1, 2), (u64::MAX, 9)] {
        let options = ReadOptions { max_memory: Some(max_memory), ..ReadOptions::default() };
        let scene = read_scene(folder.path(), &options).unwrap();
        let is_in_memory = |view: &&View| {
            let stores = [view.image.as_raw(), view.mask.as_ref().unwrap().coverage.as_raw()];
            stores.iter().all(|store| matches!(store, PixelStore::Memory(_)))
        };
        assert_eq!(scene.views.iter().filter(is_in_memory).count(), expected, "{max_memory} bytes");
        assert_eq!(scene.object_to_world, in_memory.object_to_world);
        for (view, same) in scene.views.iter().zip(&in_memory.views) {
            assert_eq!((&view.image, &view.mask, &view.depth), (&same.image, &same.mask, &same.depth), "{}", view.name);
        }
    }
}

#[test]
fn writing_to_pixels_of_a_scratch_file_changes_that_copy_alone() {
    let (_, folder) = dvr();
    let scene = read_scene(folder.path(), &ReadOptions { max_memory: Some(0), ..ReadOptions::default() }).unwrap();
    let mask = scene.views[0].mask.as_ref().unwrap();
    let mut inverted = mask.clone();
    image::imageops::invert(&mut inverted.coverage);
    let all = (WIDTH * HEIGHT) as usize;
    assert_eq!(inverted.object_pixels(), all - mask.object_pixels());
}

#[test]
fn smaller_pictures_have_smaller_cameras() {
    let (ball, folder) = dvr();
    let scene = read_scene(folder.path(), &ReadOptions { downscale: 5, ..ReadOptions::default() }).unwrap();
    for (view, camera) in scene.views.iter().zip(&ball.cameras) {
        assert_eq!((view.camera.width, view.camera.height), (9, 7));
        let mask = view.mask.as_ref().unwrap();
        assert_eq!((view.image.dimensions(), mask.size()), ((9, 7), (9, 7)));
        let (pixel, _) = view.camera.project(glam::DVec3::ZERO);
        assert!((pixel * 5.0 - camera.project(ball.center).0).length() < 1e-6);
        // Object pixels of the small picture have depths of the object.
        let depth = view.depth.as_ref().unwrap();
        for (u, v, _) in mask.coverage.enumerate_pixels().filter(|(u, v, _)| mask.is_object(*u, *v)) {
            assert!((depth.get(u, v) * 60.0 - 130.0).abs() < 1.1 * ball.radius as f32);
        }
    }
    let error = read_scene(folder.path(), &ReadOptions { downscale: 40, ..ReadOptions::default() }).unwrap_err();
    assert!(error.to_string().contains("48x36 pixels cannot be scaled down by 40"), "{error}");
    assert!(read_scene(folder.path(), &ReadOptions { downscale: 0, ..ReadOptions::default() }).is_err());
}

#[test]
fn fewer_views_are_spread_over_all() {
    let (_, folder) = dvr();
    let scene = read_scene(folder.path(), &ReadOptions { n_views: Some(3), ..ReadOptions::default() }).unwrap();
    assert_eq!(names(&scene), ["0001", "0004", "0007"]);
    let scene = read_scene(folder.path(), &ReadOptions { n_views: Some(99), ..ReadOptions::default() }).unwrap();
    assert_eq!(scene.views.len(), 9);
    assert_eq!(scene.views_of(Split::Train).count(), 9);
}

#[test]
fn ignored_views_go_by_name_or_number() {
    let (_, folder) = dvr();
    let ignored_views = vec!["0003".to_owned(), "7".to_owned()];
    let scene = read_scene(folder.path(), &ReadOptions { ignored_views, ..ReadOptions::default() }).unwrap();
    assert_eq!(names(&scene), ["0000", "0001", "0002", "0004", "0005", "0006", "0008"]);
    let ignored_views = vec!["cat".to_owned()];
    let error = read_scene(folder.path(), &ReadOptions { ignored_views, ..ReadOptions::default() }).unwrap_err();
    assert!(error.to_string().contains("no view `cat`") && error.to_string().contains("0000, 0001"), "{error}");
}

#[test]
fn sparse_points_know_the_views_that_are_left() {
    let (ball, folder) = dvr();
    let arrays = [
        ("points".to_owned(), Array::f64(&[1, 3], ball.center.to_array().to_vec())),
        ("visibility_0002".to_owned(), Array::f32(&[1], vec![0.0])),
        ("visibility_0005".to_owned(), Array::f32(&[1], vec![0.0])),
    ];
    save(&folder.path().join("pcl.npz"), &arrays);
    let ignored_views = vec!["0001".to_owned(), "0005".to_owned()];
    let scene = read_scene(folder.path(), &ReadOptions { ignored_views, ..ReadOptions::default() }).unwrap();
    assert_eq!(scene.sparse_points.unwrap().visible_in, [[1]]);
    assert_eq!(scene.views[1].name, "0002");
}

#[test]
fn a_plain_background_makes_masks_on_request_only() {
    let (ball, folder) = dvr();
    std::fs::remove_dir_all(folder.path().join("mask")).unwrap();
    assert!(read(folder.path()).views.iter().all(|view| view.mask.is_none()));
    for color in [BackgroundColor::White, BackgroundColor::Border] {
        let background = Some(Background::of(color));
        let scene = read_scene(folder.path(), &ReadOptions { background, ..ReadOptions::default() }).unwrap();
        for (view, camera) in scene.views.iter().zip(&ball.cameras) {
            assert_eq!(view.mask, Some(ball.mask(camera)));
        }
    }
}

#[test]
fn the_object_can_be_placed_by_masks_or_by_hand_in_any_layout() {
    let (ball, folder) = dvr();
    let third = [0.4 / 3.0, 0.8 / 3.0, 0.8 / 3.0];
    let points = [("points".to_owned(), Array::f64(&[1, 3], third.to_vec()))];
    save(&folder.path().join("pointcloud.npz"), &points);
    let by_files = read(folder.path());
    let given = Similarity { scale: 70.0, translation: ball.center + 3.0, ..Similarity::default() };
    for normalise in [Normalise::Hull, Normalise::Given(given)] {
        let scene = read_scene(folder.path(), &ReadOptions { normalise, ..ReadOptions::default() }).unwrap();
        ball.assert_same_cameras(&scene);
        ball.assert_in_cube(&scene);
        let world = |scene: &Scene| {
            let point = scene.ground_truth.surface.as_ref().unwrap().points[0];
            scene.object_to_world.transform_point(point.as_dvec3())
        };
        assert!((world(&scene) - world(&by_files)).length() < 1e-4);
        let z = |scene: &Scene| scene.views[0].depth.as_ref().unwrap().get(24, 18) * scene.object_to_world.scale as f32;
        assert!((z(&scene) - z(&by_files)).abs() < 1e-3);
    }
    // A ball that sticks out of the cube is warned of.
    let small = Similarity { scale: 30.0, translation: ball.center, ..Similarity::default() };
    let options = ReadOptions { normalise: Normalise::Given(small), ..ReadOptions::default() };
    let warnings = read_scene(folder.path(), &options).unwrap().warnings;
    assert!(warnings.iter().any(|warning| warning.contains("look past the unit cube")), "{warnings:?}");
}

#[test]
fn a_layout_that_does_not_say_where_the_object_is_cannot_be_asked() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_middlebury(folder.path());
    let options = ReadOptions { normalise: Normalise::Files, ..ReadOptions::default() };
    let error = read_scene(folder.path(), &options).unwrap_err().to_string();
    assert!(error.contains("Middlebury layout does not say where the object is"), "{error}");
}

#[test]
fn the_depth_of_the_visual_hull_is_taken_where_it_is_wanted_or_alone() {
    let (ball, folder) = dvr();
    let hull_folder = folder.path().join("visual_hull_depth");
    std::fs::create_dir_all(&hull_folder).unwrap();
    for (i, camera) in ball.cameras.iter().enumerate() {
        write_depth_exr(&hull_folder.join(format!("{i:04}.exr")), &ball.depth(camera).scaled(0.5)).unwrap();
    }
    let center = |scene: &Scene| scene.views[2].depth.as_ref().unwrap().get(24, 18);
    let measured = center(&read(folder.path()));
    let options = ReadOptions { visual_hull_depth: true, ..ReadOptions::default() };
    let scene = read_scene(folder.path(), &options).unwrap();
    assert!((center(&scene) - 0.5 * measured).abs() < 1e-5 && scene.warnings.is_empty());
    std::fs::remove_dir_all(folder.path().join("depth")).unwrap();
    let scene = read(folder.path());
    assert!((center(&scene) - 0.5 * measured).abs() < 1e-5);
    assert!(scene.warnings[0].contains("visual hull"), "{:?}", scene.warnings);
}

#[test]
fn mask_files_are_refined_by_their_photographs_when_that_is_wanted() {
    let (ball, folder) = dvr();
    // A hole in one mask, rims around most of the others.
    let write = |view: usize, object: &dyn Fn(u32, u32) -> bool| {
        let coverage = GrayImage::from_fn(WIDTH, HEIGHT, |u, v| Luma([if object(u, v) { 255 } else { 0 }]));
        write_gray_png(&folder.path().join(format!("mask/{view:04}.png")), &coverage).unwrap();
    };
    let right: Vec<Mask> = ball.cameras.iter().map(|camera| ball.mask(camera)).collect();
    write(3, &|u, v| right[3].is_object(u, v) && !((22..25).contains(&u) && (16..20).contains(&v)));
    for (wide, right) in right.iter().enumerate().skip(4) {
        let at = |place: u32, offset: u32, side: u32| (place + offset).saturating_sub(2).min(side - 1);
        let near = |u, v, i: u32| right.is_object(at(u, i % 5, WIDTH), at(v, i / 5, HEIGHT));
        write(wide, &|u, v| (0..25).any(|i| near(u, v, i)));
    }
    let mut scene = read(folder.path());
    assert!(!scene.views[3].is_object(23, 17), "masks are read as they are");
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let report = refine_masks(&mut scene, &Cancellation::default()).unwrap();
    assert!(scene.views.iter().zip(&right).all(|(view, right)| view.training_mask() == Some(right)));
    assert!(!scene.views[3].is_object(23, 17), "masks as given stay");
    for part in ["1 of 9 masks leave out", "(12 pixels", "5 of 9 masks have a rim"] {
        assert!(report.notes().iter().any(|note| note.contains(part)), "{part}: {report}");
    }
    // The same from a scratch file.
    let options = ReadOptions { max_memory: Some(0), ..ReadOptions::default() };
    let mut paged = read_scene(folder.path(), &options).unwrap();
    assert_eq!(refine_masks(&mut paged, &Cancellation::default()).unwrap(), report);
    for (view, same) in paged.views.iter().zip(&scene.views) {
        assert_eq!(view.refined_mask, same.refined_mask);
        assert!(view.refined_mask.iter().all(|mask| mask.coverage.as_raw().is_paged()));
    }
}

#[test]
fn a_scene_without_masks_is_read_all_the_same() {
    let (ball, folder) = dvr();
    std::fs::remove_dir_all(folder.path().join("mask")).unwrap();
    let scene = read(folder.path());
    assert_eq!(scene.views.len(), ball.cameras.len());
    assert!(scene.views.iter().all(|view| view.mask.is_none() && view.training_mask().is_none()));
    assert!(scene.warnings.iter().any(|warning| warning.contains("9 of 9 views have no mask")), "{:?}", scene.warnings);
    let error = scene.require_masks().unwrap_err().to_string();
    for way in ["views `0000`, `0001`, `0002` and 6 more have no mask", "alpha", "`mask`", "background"] {
        assert!(error.contains(way), "{error}");
    }
}
