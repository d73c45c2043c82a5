//! Every layout gives the cameras, masks and depths that were written.

use glam::Vec3;
use image::{DynamicImage, Rgba, RgbaImage};

use super::*;
use crate::npz::Values;
use crate::pixels::stored;
use crate::scene::Split;

#[test]
fn the_dvr_layout_keeps_its_object_space() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_dvr(folder.path());
    assert_eq!(read(&folder.path().join("cameras.npz")).format, "DVR");
    let scene = read(folder.path());
    assert_eq!((scene.format, scene.views.len()), ("DVR", 9));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert!((scene.object_to_world.scale - ball.object_to_world().scale).abs() < 1e-9);
    ball.assert_same_cameras(&scene);
    for (view, camera) in scene.views.iter().zip(&ball.cameras) {
        assert_eq!((&view.mask, &view.image), (&Some(ball.mask(camera)), &stored(ball.image(camera))));
        let (depth, expected) = (view.depth.as_ref().unwrap(), ball.depth(camera));
        for (z, world_z) in depth.z_depth.iter().zip(&expected.z_depth) {
            let expected = world_z / ball.object_to_world().scale as f32;
            assert!(*z == expected || (z - expected).abs() < 1e-5, "{z} is not {expected}");
        }
    }
}

#[test]
fn depth_is_found_however_the_matrices_share_the_scale() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_dvr(folder.path());
    // The same cameras with the scale in world_mat, and no scale_mat: depth is in object units already.
    let to_object = ball.object_to_world();
    let mut arrays = Vec::new();
    for (i, camera) in ball.cameras.iter().enumerate() {
        let camera_mat = NpzFile::open(&folder.path().join("cameras.npz")).unwrap().read(&format!("camera_mat_{i}"));
        arrays.push((format!("camera_mat_{i}"), camera_mat.unwrap()));
        let world_mat = camera.world_to_camera() * to_object.to_matrix();
        let rows: Vec<f64> = (0..3).flat_map(|row| world_mat.row(row).to_array()).collect();
        arrays.push((format!("world_mat_{i}"), Array::f32(&[3, 4], rows.into_iter().map(|x| x as f32).collect())));
    }
    save(&folder.path().join("cameras.npz"), &arrays);
    let scene = read(folder.path());
    assert_eq!(scene.object_to_world, Similarity::default());
    let (view, camera) = (&scene.views[4], &ball.cameras[4]);
    let (pixel, z) = view.camera.project(glam::DVec3::ZERO);
    let (expected, world_z) = camera.project(ball.center);
    assert!((pixel - expected).length() < 1e-3 && (z * to_object.scale - world_z).abs() < 1e-3);
    let (u, v) = (pixel.x as u32, pixel.y as u32);
    let expected = ball.depth(camera).get(u, v) / to_object.scale as f32;
    assert!((view.depth.as_ref().unwrap().get(u, v) - expected).abs() < 1e-4);
}

#[test]
fn mirrored_cameras_get_mirrored_pictures() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_dvr(folder.path());
    let straight = read(folder.path());
    // Flip every file and every camera: the same scene again, as a left-handed renderer would have written it.
    let path = folder.path().join("cameras.npz");
    let mut npz = NpzFile::open(&path).unwrap();
    let flip = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mut arrays: Vec<(String, Array)> = Vec::new();
    for name in npz.names().to_vec() {
        let array = npz.read(&name).unwrap();
        let values = DMat4::from_cols_slice(&array.to_f64()).transpose();
        arrays.push((name.clone(), if name.starts_with("camera") { matrix(&(flip * values)) } else { array }));
    }
    save(&path, &arrays);
    for view in &straight.views {
        let image = image::imageops::flip_horizontal(&view.image);
        write_rgb_png(&folder.path().join(format!("image/{}.png", view.name)), &image).unwrap();
        let mask = image::imageops::flip_horizontal(&view.mask.as_ref().unwrap().coverage);
        write_gray_png(&folder.path().join(format!("mask/{}.png", view.name)), &mask).unwrap();
    }
    std::fs::remove_dir_all(folder.path().join("depth")).unwrap();
    let scene = read(folder.path());
    assert!(scene.warnings[0].contains("9 of 9 views make mirror images"), "{:?}", scene.warnings);
    ball.assert_same_cameras(&scene);
    for (view, expected) in scene.views.iter().zip(&straight.views) {
        assert_eq!((&view.image, &view.mask), (&expected.image, &expected.mask));
    }
}

#[test]
fn the_true_shape_and_the_sparse_points_come_along() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_dvr(folder.path());
    let save_in = |name: &str, arrays: &[(&str, Array)]| {
        let arrays: Vec<_> = arrays.iter().map(|(name, array)| ((*name).to_owned(), array.clone())).collect();
        save(&folder.path().join(name), &arrays);
    };
    let third = 1.0 / 3.0;
    save_in(
        "pointcloud.npz",
        &[
            ("points", Array::f32(&[2, 3], vec![0.4, 0.0, 0.0, 0.0, -0.4, 0.0])),
            ("normals", Array::f32(&[2, 3], vec![1.0, 0.0, 0.0, 0.0, -1.0, 0.0])),
        ],
    );
    let packed = Array { shape: vec![2], values: Values::U8(vec![0b1100_0000, 0b1000_0000]) };
    save_in(
        "points.npz",
        &[("points", Array::f32(&[9, 3], (0..27).map(|i| i as f32 / 100.0).collect())), ("occupancies", packed)],
    );
    let on_ball = |x: f64, y: f64, z: f64| ball.center + ball.radius * DVec3::new(x, y, z);
    let world = [on_ball(third, 2.0 * third, 2.0 * third), on_ball(0.0, 0.0, 0.5), on_ball(9.0, 0.0, 0.0)];
    save_in(
        "pcl.npz",
        &[
            ("points", Array::f64(&[3, 3], world.iter().flat_map(|p| p.to_array()).collect())),
            ("colors", Array { shape: vec![3, 3], values: Values::U8(vec![0, 51, 255, 1, 2, 3, 4, 5, 6]) }),
            ("is_in_visual_hull", Array { shape: vec![3], values: Values::Bool(vec![true, true, false]) }),
            ("visibility_0000", Array { shape: vec![2], values: Values::I64(vec![0, 2]) }),
            ("visibility_0003", Array { shape: vec![3], values: Values::Bool(vec![true, false, false]) }),
        ],
    );
    let scene = read(folder.path());
    let surface = scene.ground_truth.surface.unwrap();
    assert_eq!(surface.points[1], Vec3::new(0.0, -0.4, 0.0));
    assert_eq!(surface.normals.unwrap()[0], Vec3::X);
    let inside = scene.ground_truth.occupancy.unwrap().inside;
    assert_eq!(inside, [true, true, false, false, false, false, false, false, true]);
    // The point that no view sees and the one out of the hull are gone.
    let sparse = scene.sparse_points.unwrap();
    assert_eq!(sparse.visible_in, [[0, 3]]);
    assert!((sparse.cloud.points[0] - Vec3::new(1.0, 2.0, 2.0) / (3.0 * 2.4)).length() < 1e-6);
    assert_eq!(sparse.cloud.colors.unwrap()[0], [0.0, 0.2, 1.0]);
}

#[test]
fn a_dataset_lists_its_objects_and_a_single_one_is_taken() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    let root = folder.path();
    ball.write_dvr(&root.join("0301/one"));
    std::fs::write(root.join("metadata.yaml"), "0301:\n  id: 0301\n  name: 'chair,seat'\n").unwrap();
    assert_eq!(read(root).name, "one");
    assert_eq!(detect_format(root).unwrap(), Format::DVR);
    std::fs::write(root.join("0301/softras_train.lst"), "one\n").unwrap();
    std::fs::write(root.join("0301/softras_test.lst"), "one\n\n").unwrap();
    assert_eq!(read(root).name, "one", "the same object in two lists is one object");
    let objects = list_objects(root, Some(Split::Test)).unwrap();
    let expected = ObjectRef {
        category: "0301".to_owned(),
        category_name: "chair,seat".to_owned(),
        name: "one".to_owned(),
        path: root.join("0301/one"),
        split: Split::Test,
    };
    assert_eq!(objects, [expected]);
    assert_eq!(list_objects(&root.join("0301"), None).unwrap().len(), 2);
    assert!(list_objects(root, Some(Split::Val)).unwrap().is_empty());

    ball.write_dvr(&root.join("0301/two"));
    std::fs::write(root.join("0301/softras_train.lst"), "one\ntwo\n").unwrap();
    let error = read_scene(root, &ReadOptions::default()).unwrap_err().to_string();
    assert!(error.contains("holds 2 objects") && error.contains("0301/two"), "{error}");
    std::fs::write(root.join("0301/softras_train.lst"), "one\nthree\n").unwrap();
    let error = list_objects(root, None).unwrap_err().to_string();
    assert!(error.contains("softras_train.lst: object `three` has no folder"), "{error}");
}

#[test]
fn the_idr_layout_has_pixel_centres_at_integers() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_idr(folder.path());
    for path in [folder.path().to_owned(), folder.path().join("cameras_sphere.npz")] {
        let scene = read(&path);
        assert_eq!(scene.format, "IDR/NeuS");
        ball.assert_same_cameras(&scene);
        ball.assert_in_cube(&scene);
    }
    let options = ReadOptions { normalise: Normalise::Files, ..ReadOptions::default() };
    let scene = read_scene(folder.path(), &options).unwrap();
    assert!((scene.object_to_world.scale - 2.6 * ball.radius).abs() < 1e-9, "the sphere fits the cube");
    ball.assert_same_cameras(&scene);
    std::fs::rename(folder.path().join("cameras_sphere.npz"), folder.path().join("cameras.npz")).unwrap();
    assert_eq!(detect_format(folder.path()).unwrap(), "idr".parse().unwrap(), "cameras.npz without camera_mat");
}

#[test]
fn the_middlebury_layout_reads() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_middlebury(folder.path());
    for path in [folder.path().to_owned(), folder.path().join("ballSR_par.txt")] {
        let scene = read(&path);
        assert_eq!(scene.format, "Middlebury");
        ball.assert_same_cameras(&scene);
        ball.assert_in_cube(&scene);
    }
}

#[test]
fn the_llff_layout_reads() {
    let (mut ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    for camera in &mut ball.cameras {
        *camera = Camera::look_at(WIDTH, HEIGHT, 60.0, camera.center(), ball.center, DVec3::Y);
    }
    ball.write_images(&folder.path().join("images"), Some(&folder.path().join("masks")));
    let row = |camera: &Camera| {
        let [right, down, forward] = [0, 1, 2].map(|axis| camera.rotation.row(axis));
        let columns = [down, right, -forward, camera.center(), DVec3::new(HEIGHT.into(), WIDTH.into(), 60.0)];
        let matrix = (0..3).flat_map(|axis| columns.map(|column| column[axis]));
        matrix.chain([80.0, 200.0]).collect::<Vec<f64>>()
    };
    let path = folder.path().join("poses_bounds.npy");
    let write = |rows: &[Vec<f64>]| write_npy_file(&path, &[rows.len(), rows[0].len()], &rows.concat());
    let mut rows: Vec<Vec<f64>> = ball.cameras.iter().map(row).collect();
    write(&rows);
    for path in [folder.path(), &path] {
        let scene = read(path);
        assert_eq!(scene.format, "LLFF");
        ball.assert_same_cameras(&scene);
        ball.assert_in_cube(&scene);
    }
    let said = |rows: &[Vec<f64>]| {
        write(rows);
        read_scene(folder.path(), &ReadOptions::default()).unwrap_err().to_string()
    };
    assert!(said(&rows[1..]).contains("8 cameras, and 9 pictures"));
    assert!(said(&rows.iter().map(|row| row[..15].to_vec()).collect::<Vec<_>>()).contains("[9, 15]"));
    rows[4][0] = 9.0;
    assert!(said(&rows).contains("the camera of `0004` has no rotation"));
    rows[4] = rows[3].clone();
    rows[4][14] = f64::NAN;
    assert!(said(&rows).contains("focal length of NaN"));
    std::fs::write(&path, "poses").unwrap();
    assert!(read_scene(folder.path(), &ReadOptions::default()).unwrap_err().to_string().contains("cannot be read"));
}

/// As numpy.save writes doubles.
fn write_npy_file(path: &Path, shape: &[usize], values: &[f64]) {
    let shape = shape.iter().map(|n| format!("{n},")).collect::<String>();
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}");
    header += &" ".repeat(63 - (10 + header.len()) % 64);
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn nerfstudio_transforms_read() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_transforms(folder.path());
    let scene = read(folder.path());
    assert_eq!(scene.format, "NeRF transforms");
    ball.assert_same_cameras(&scene);
    ball.assert_in_cube(&scene);
}

#[test]
fn nerf_splits_read_with_alpha_and_one_angle_for_all() {
    let (mut ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    let root = folder.path();
    for camera in &mut ball.cameras {
        *camera = Camera::look_at(WIDTH, HEIGHT, 60.0, camera.center(), ball.center, DVec3::Y);
    }
    let angle = 2.0 * (0.5 * f64::from(WIDTH) / 60.0).atan();
    for (split, range) in [("train", 0..5), ("val", 5..7), ("test", 7..9)] {
        std::fs::create_dir_all(root.join(split)).unwrap();
        let mut frames = Vec::new();
        for (i, camera) in ball.cameras[range].iter().enumerate() {
            let (image, mask) = (ball.image(camera), ball.mask(camera));
            let rgba = RgbaImage::from_fn(WIDTH, HEIGHT, |u, v| {
                let [r, g, b] = image.get_pixel(u, v).0;
                Rgba([r, g, b, mask.coverage.get_pixel(u, v).0[0]])
            });
            DynamicImage::from(rgba).save(root.join(format!("{split}/r_{i}.png"))).unwrap();
            let matrix = ball.frame(camera, "")["transform_matrix"].clone();
            frames.push(serde_json::json!({ "file_path": format!("./{split}/r_{i}"), "transform_matrix": matrix }));
        }
        frames.extend((split == "test").then(|| {
            serde_json::json!({ "file_path": "./test/r_9", "transform_matrix": frames[0]["transform_matrix"].clone() })
        }));
        let json = serde_json::json!({ "camera_angle_x": angle, "frames": frames });
        std::fs::write(root.join(format!("transforms_{split}.json")), json.to_string()).unwrap();
    }
    let scene = read(root);
    ball.assert_same_cameras(&scene);
    ball.assert_in_cube(&scene);
    let names: Vec<&str> = scene.views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!((names[0], names[8]), ("train_r_0", "test_r_1"));
    let count = |split| scene.views_of(split).count();
    assert_eq!((count(Split::Train), count(Split::Val), count(Split::Test)), (5, 2, 2));
    assert!(scene.warnings[0].contains("1 of 3 pictures") && scene.warnings[0].contains("r_9"), "{:?}", scene.warnings);
    assert_eq!(scene.views[3].mask, Some(ball.mask(&ball.cameras[3])));
    assert_eq!(read(&root.join("transforms_train.json")).views.len(), 5);
    // Files of one name in several folders: only the views' names tell them apart.
    let found = |name: &str| places_in_view(root, &ReadOptions::default(), name, &[glam::DVec2::ONE]);
    let refused = found("r_0.png").unwrap_err().to_string();
    assert!(["train_r_0", "val_r_0", "test_r_0"].iter().all(|name| refused.contains(name)), "{refused}");
    assert_eq!(found("val_r_0").unwrap().view, "val_r_0");
    assert_eq!(found("r_4.png").unwrap().view, "train_r_4");
}

#[test]
fn the_cloud_of_nerfstudio_comes_along_where_it_is_on_the_object() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_transforms(folder.path());
    let at = |x: f64| (ball.center + DVec3::new(0.0, x * ball.radius, 0.0)).as_vec3();
    let cloud = crate::mesh::Mesh { vertices: vec![at(0.99), at(0.5), at(1.4)], ..Default::default() };
    crate::mesh::write_mesh(folder.path().join("sparse_pc.ply"), &cloud).unwrap();
    let path = folder.path().join("transforms.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen('{', r#"{"ply_file_path": "sparse_pc.ply", "#, 1)).unwrap();
    let scene = read(folder.path());
    let sparse = scene.sparse_points.as_ref().unwrap();
    assert_eq!(sparse.cloud.points.len(), 2, "the third is beside the ball");
    assert!(!sparse.has_tracks() && sparse.visible_in.len() == 2);
    let verified = crate::VerifiedPoints::of_scene(&scene).unwrap();
    assert!((verified.points[0] - at(0.99).as_dvec3()).length() < 1e-3 && verified.tracks.is_none());
    std::fs::remove_file(folder.path().join("sparse_pc.ply")).unwrap();
    let without = read(folder.path());
    assert!(without.sparse_points.is_none());
    assert!(without.warnings.iter().any(|warning| warning.contains("sparse_pc.ply")), "{:?}", without.warnings);
}
