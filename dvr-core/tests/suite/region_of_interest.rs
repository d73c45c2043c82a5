//! Masks, cameras and sparse points together say where the object is.

use std::path::Path;

use dvr_core::dataset::{Normalise, ReadOptions, read_scene};
use dvr_core::hull::Bounds;
use dvr_core::mesh::{Mesh, write_mesh};
use dvr_core::{Camera, RegionEvidence, Scene};
use glam::{DQuat, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};

const SIZE: u32 = 64;

fn ball(ray: &dvr_core::Ray, radius: f64) -> bool {
    ray.origin.cross(ray.direction.normalize()).length() < radius
}

/// A square plate below the origin.
fn plate(ray: &dvr_core::Ray, half: f64) -> bool {
    let at = ray.at((-0.3 - ray.origin.y) / ray.direction.y);
    ray.direction.y < 0.0 && at.x.abs() < half && at.z.abs() < half
}

/// Cameras on one side of the origin, looking down at it.
fn cameras() -> Vec<Camera> {
    let camera = |i: usize| {
        let (azimuth, elevation) = (-1.0 + 0.25 * (i % 9) as f64, 0.5 + 0.3 * (i / 9) as f64);
        let eye = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
        Camera::look_at(SIZE, SIZE, 1.2 * f64::from(SIZE), 1.6 * eye, DVec3::ZERO, DVec3::Y)
    };
    (0..18).map(camera).collect()
}

/// Writes a scene in nerfstudio's layout and reads it.
fn read(root: &Path, shown: impl Fn(&dvr_core::Ray) -> bool, points: &[DVec3]) -> Scene {
    read_views(root, |_, ray| shown(ray), points)
}

/// The same with masks that differ from view to view.
fn read_views(root: &Path, shown: impl Fn(usize, &dvr_core::Ray) -> bool, points: &[DVec3]) -> Scene {
    ["images", "masks"].iter().for_each(|name| std::fs::create_dir_all(root.join(name)).unwrap());
    let mut frames = Vec::new();
    for (i, camera) in cameras().iter().enumerate() {
        let mask =
            GrayImage::from_fn(SIZE, SIZE, |u, v| Luma([if shown(i, &camera.pixel_ray(u, v)) { 255 } else { 0 }]));
        RgbImage::from_pixel(SIZE, SIZE, Rgb([90; 3])).save(root.join(format!("images/{i:02}.png"))).unwrap();
        mask.save(root.join(format!("masks/{i:02}.png"))).unwrap();
        let (rotation, center) = (camera.rotation.transpose(), camera.center());
        let row = |r: usize| [rotation.row(r).x, -rotation.row(r).y, -rotation.row(r).z, center[r]];
        frames.push(serde_json::json!({
            "file_path": format!("images/{i:02}.png"), "mask_path": format!("masks/{i:02}.png"),
            "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
        }));
    }
    let mut json = serde_json::json!({ "fl_x": 1.2 * f64::from(SIZE), "w": SIZE, "h": SIZE, "frames": frames });
    if !points.is_empty() {
        let vertices = points.iter().map(|point| point.as_vec3()).collect();
        write_mesh(root.join("points.ply"), &Mesh { vertices, ..Mesh::default() }).unwrap();
        json["ply_file_path"] = "points.ply".into();
    }
    std::fs::write(root.join("transforms.json"), json.to_string()).unwrap();
    read_scene(root, &ReadOptions::default()).unwrap()
}

/// Points in a ball, `count` of them on a spiral.
fn points(count: usize, radius: f64) -> Vec<DVec3> {
    let point = |i: usize| {
        let y = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
        let (sin, cos) = (2.4 * i as f64).sin_cos();
        radius * DVec3::new(cos * (1.0 - y * y).sqrt(), y, sin * (1.0 - y * y).sqrt())
    };
    (0..count).map(point).collect()
}

#[test]
fn cameras_bound_what_the_frame_cuts_in_all_views_and_points_do_better() {
    let folder = tempfile::tempdir().unwrap();
    let shown = |ray: &dvr_core::Ray| plate(ray, 2.0) || ball(ray, 0.25);
    let by_cameras = read(folder.path(), shown, &[]);
    assert_eq!(by_cameras.region.evidence, [RegionEvidence::Masks, RegionEvidence::Cameras]);
    // What most pictures show is 1.33 wide at the origin; their corners are 0.94 from it.
    let reach = by_cameras.region.bounds.size() * by_cameras.object_to_world.scale;
    assert!(reach.max_element() < 2.0 * 0.95, "{reach}");
    let notes = by_cameras.region_notes();
    assert!(notes.iter().any(|note| note.contains("beyond the region")), "{notes:?}");
    assert!(notes.iter().any(|note| note.contains("in 18 of 18 views")), "{notes:?}");
    // Points of the ball, with two in a hundred that lie far behind it, below the plate.
    let mut cloud = points(196, 0.25);
    cloud.extend((0..4).map(|i| DVec3::new(0.0, -1.4, -0.3 * f64::from(i))));
    let by_points = read(folder.path(), shown, &cloud);
    let last = by_points.region.evidence.last().unwrap();
    assert!(matches!(last, RegionEvidence::Points(count) if *count >= 190), "{:?}", by_points.region);
    let size = by_points.region.bounds.size() * by_points.object_to_world.scale;
    assert!(size.max_element() < 0.8 && size.min_element() > 0.5, "{size}");
    assert!(by_points.region.to_string().ends_with("sparse points within the masks"), "{}", by_points.region);
}

#[test]
fn a_box_that_is_given_is_the_region_whatever_masks_show() {
    let folder = tempfile::tempdir().unwrap();
    let found = read(folder.path(), |ray| ball(ray, 0.3), &[]);
    let bounds = Bounds { min: DVec3::new(-0.1, -0.2, 0.05), max: DVec3::new(0.3, 0.25, 0.2) };
    let given = |bounds| {
        read_scene(folder.path(), &ReadOptions { normalise: Normalise::Box(bounds), ..ReadOptions::default() })
    };
    let scene = given(bounds).unwrap();
    assert_eq!(scene.region.evidence, [RegionEvidence::Box]);
    assert_eq!(scene.region.to_string(), "the box that was given");
    assert_eq!((scene.object_to_world.rotation, scene.object_to_world.translation), (DQuat::IDENTITY, bounds.center()));
    let corners = [scene.region.bounds.min, scene.region.bounds.max];
    for (corner, expected) in corners.iter().zip([bounds.min, bounds.max]) {
        assert!(scene.object_to_world.transform_point(*corner).abs_diff_eq(expected, 1e-12), "{corner}");
    }
    assert!((scene.region.bounds.size().max_element() - 0.9).abs() < 1e-12, "the margin of a hull");
    // The same camera, in the units of the files.
    let in_files = |scene: &Scene| scene.object_to_world.transform_point(scene.views[0].camera.center());
    assert!(in_files(&scene).abs_diff_eq(in_files(&found), 1e-9));
    // What was read is read again by its similarity, as runs do.
    let again = Normalise::Given(scene.object_to_world);
    let again = read_scene(folder.path(), &ReadOptions { normalise: again, ..ReadOptions::default() }).unwrap();
    assert_eq!(again.object_to_world, scene.object_to_world);
    for wrong in [DVec3::new(0.3, 0.25, 0.05), DVec3::new(0.3, f64::NAN, 0.2), DVec3::new(0.3, f64::INFINITY, 0.2)] {
        let error = given(Bounds { max: wrong, ..bounds }).unwrap_err().to_string();
        assert!(error.contains("the box"), "{error}");
    }
}

#[test]
fn a_sound_hull_is_not_cut_by_points_that_cover_a_part() {
    let folder = tempfile::tempdir().unwrap();
    let shown = |ray: &dvr_core::Ray| ball(ray, 0.3);
    let without = read(folder.path(), shown, &[]);
    assert_eq!(without.region.evidence, [RegionEvidence::Masks]);
    assert!(without.region_notes().is_empty() && without.region.cut_off() == 0.0);
    let upper: Vec<DVec3> = points(300, 0.28).into_iter().filter(|point| point.y > 0.15).collect();
    let with = read(folder.path(), shown, &upper);
    assert!(with.sparse_points.is_some());
    assert_eq!((with.region, with.object_to_world), (without.region, without.object_to_world));
}

#[test]
fn masks_of_views_for_testing_do_not_say_where_the_object_is_or_what_lies_on_it() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = points(200, 0.24);
    // A half of the ball is missing in the masks of these views.
    let reading = |halved: &[usize]| {
        let shown = |i, ray: &dvr_core::Ray| {
            let is_left = ray.origin.cross(ray.direction).dot(DVec3::Y) > 0.0;
            ball(ray, 0.3) && !(halved.contains(&i) && is_left)
        };
        let scene = read_views(folder.path(), shown, &cloud);
        let on_object = scene.sparse_points.as_ref().map(|sparse| sparse.cloud.points.clone());
        (scene.region, scene.object_to_world, on_object)
    };
    let whole = reading(&[]);
    assert_eq!(whole.2.as_ref().map(Vec::len), Some(cloud.len()));
    // One in eight of eighteen.
    let mut divided = read(folder.path(), |ray| ball(ray, 0.3), &cloud);
    assert_eq!(divided.hold_out(8).test, ["04", "12"]);
    assert_eq!(reading(&[4, 12]), whole);
    let spoiled = reading(&[5, 13]);
    assert!(spoiled.1 != whole.1, "the hull of the views to train on is another: {:?}", spoiled.1);
    assert!(spoiled.2 != whole.2, "and so are the points on it");
}

#[test]
fn points_far_off_and_few_points_make_no_box() {
    let mut cloud = points(200, 0.3);
    let clean = dvr_core::hull::point_box(&cloud).unwrap();
    cloud.extend([DVec3::splat(50.0), DVec3::splat(-80.0), DVec3::X * 1e6]);
    let trimmed = dvr_core::hull::point_box(&cloud).unwrap();
    assert!(
        (trimmed.min - clean.min).abs().max_element() < 0.03 && (trimmed.max - clean.max).abs().max_element() < 0.03
    );
    assert!(clean.min.cmple(DVec3::splat(-0.3)).all() && clean.max.cmpge(DVec3::splat(0.3)).all(), "{clean:?}");
    assert!(dvr_core::hull::point_box(&cloud[..49]).is_none());
    assert!(dvr_core::hull::point_box(&[DVec3::ONE; 60]).is_none());
}
