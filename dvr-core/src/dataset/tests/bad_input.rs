//! Whatever is wrong with the files, the error names the file, the value and the remedy.

use super::*;
use crate::error::Error;

fn dvr() -> (Ball, tempfile::TempDir) {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_dvr(folder.path());
    (ball, folder)
}

#[track_caller]
fn refused(path: &Path, words: &[&str]) {
    let message = match read_scene(path, &ReadOptions::default()) {
        Ok(scene) => panic!("read {} views", scene.views.len()),
        Err(error) => error.to_string(),
    };
    for word in words {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

fn truncate(path: &Path) {
    let bytes = std::fs::read(path).unwrap();
    std::fs::write(path, &bytes[..bytes.len() / 2]).unwrap();
}

/// Replaces one array of the cameras' file, or removes it.
fn change_camera(root: &Path, name: &str, change: impl Fn(DMat4) -> Option<DMat4>) {
    let path = root.join("cameras.npz");
    let mut npz = NpzFile::open(&path).unwrap();
    let mut arrays = Vec::new();
    for other in npz.names().to_vec() {
        let array = npz.read(&other).unwrap();
        if other == name {
            let changed = change(DMat4::from_cols_slice(&array.to_f64()).transpose());
            arrays.extend(changed.map(|changed| (other, matrix(&changed))));
        } else {
            arrays.push((other, array));
        }
    }
    save(&path, &arrays);
}

#[test]
fn nothing_there() {
    refused(Path::new("/no/such/scene"), &["/no/such/scene", "No such file"]);
    let folder = tempfile::tempdir().unwrap();
    let looked_for =
        ["cameras.npz", "transforms.json", "cameras_sphere.npz", "_par.txt", "sparse/0", "poses_bounds.npy"];
    refused(folder.path(), &looked_for);
    std::fs::write(folder.path().join("notes.md"), "").unwrap();
    refused(&folder.path().join("notes.md"), &looked_for);
}

#[test]
fn a_format_that_is_named_but_not_there() {
    let folder = tempfile::tempdir().unwrap();
    for format in Format::all() {
        let options = ReadOptions { format: Some(format), ..ReadOptions::default() };
        let error = read_scene(folder.path(), &options).unwrap_err();
        assert!(matches!(error, Error::Format { .. }), "{format}: {error}");
        let missing = read_scene(Path::new("/no/such"), &options).unwrap_err().to_string();
        assert!(missing.contains("/no/such"), "{format}: {missing}");
    }
}

#[test]
fn truncated_files() {
    for file in ["image/0003.png", "mask/0002.png", "depth/0005.exr", "cameras.npz"] {
        let (_, folder) = dvr();
        truncate(&folder.path().join(file));
        refused(folder.path(), &[file, "truncated"]);
    }
}

#[test]
fn a_missing_mask_is_refused_by_what_needs_one() {
    let (_, folder) = dvr();
    std::fs::remove_file(folder.path().join("mask/0004.png")).unwrap();
    let scene = read(folder.path());
    assert!(scene.views.iter().all(|view| view.mask.is_some() == (view.name != "0004")));
    let error = scene.require_masks().unwrap_err().to_string();
    for part in ["view `0004` has no mask", "alpha", "`mask`", "background"] {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn an_image_that_a_list_names_is_missing() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_middlebury(folder.path());
    std::fs::remove_file(folder.path().join("0006.png")).unwrap();
    refused(folder.path(), &["0006.png", "No such file"]);
}

#[test]
fn unusable_cameras() {
    for (name, value) in [("world_mat_3", f64::NAN), ("camera_mat_3", f64::INFINITY), ("scale_mat_3", f64::NAN)] {
        let (_, folder) = dvr();
        change_camera(folder.path(), name, |mut m| {
            m.y_axis.x = value;
            Some(m)
        });
        refused(folder.path(), &["cameras.npz", name, &value.to_string()]);
    }
    let (_, folder) = dvr();
    change_camera(folder.path(), "world_mat_3", |mut m| {
        m.x_axis = m.y_axis;
        Some(m)
    });
    refused(folder.path(), &["cameras.npz", "view `0003`", "singular"]);
    let (_, folder) = dvr();
    change_camera(folder.path(), "scale_mat_0", |_| Some(DMat4::from_scale(DVec3::new(1.0, 2.0, 1.0))));
    refused(folder.path(), &["cameras.npz", "scale"]);
}

#[test]
fn cameras_and_images_that_do_not_match() {
    let (_, folder) = dvr();
    change_camera(folder.path(), "camera_mat_8", |_| None);
    refused(folder.path(), &["cameras.npz", "8 cameras for 9 images"]);
    let (_, folder) = dvr();
    change_camera(folder.path(), "world_mat_8", |_| None);
    refused(folder.path(), &["cameras.npz", "world_mat_8"]);
}

#[test]
fn sizes_that_differ() {
    let (_, folder) = dvr();
    write_gray_png(&folder.path().join("mask/0001.png"), &GrayImage::from_pixel(47, 36, Luma([255]))).unwrap();
    refused(folder.path(), &["mask/0001.png", "47x36", "48x36"]);
    let (_, folder) = dvr();
    let depth = DepthMap { width: 24, height: 18, z_depth: vec![1.0; 24 * 18] };
    write_depth_exr(&folder.path().join("depth/0001.exr"), &depth).unwrap();
    refused(folder.path(), &["depth/0001.exr", "24x18", "48x36"]);
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_transforms(folder.path());
    for sub in ["images", "masks"] {
        write_rgb_png(&folder.path().join(sub).join("0002.png"), &RgbImage::new(36, 48)).unwrap();
    }
    refused(folder.path(), &["transforms.json", "view `0002`", "36x48", "48x36"]);
}

#[test]
fn black_masks() {
    let (ball, folder) = dvr();
    let blacken = |i: usize| {
        let path = folder.path().join(format!("mask/{i:04}.png"));
        write_gray_png(&path, &GrayImage::new(WIDTH, HEIGHT)).unwrap();
    };
    blacken(4);
    blacken(7);
    let scene = read(folder.path());
    assert!(scene.warnings[0].contains("view `0004` (and 1 more) marks no object"), "{:?}", scene.warnings);
    (0..ball.cameras.len()).for_each(blacken);
    refused(folder.path(), &["all 9 masks are empty", "inverted"]);
}

#[test]
fn a_single_view() {
    let (_, folder) = dvr();
    let options = ReadOptions { n_views: Some(1), ..ReadOptions::default() };
    let error = read_scene(folder.path(), &options).unwrap_err().to_string();
    assert!(error.contains("1 of 9 views") && error.contains("at least two"), "{error}");
}

#[test]
fn names_that_are_there_twice() {
    let (_, folder) = dvr();
    std::fs::copy(folder.path().join("image/0001.png"), folder.path().join("image/0001.jpg")).unwrap();
    refused(folder.path(), &["image: view `0001.png` is there twice"]);
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_transforms(folder.path());
    let frame = ball.frame(&ball.cameras[0], "images/0000.png");
    let json = serde_json::json!({ "frames": [frame.clone(), frame] });
    std::fs::write(folder.path().join("transforms.json"), json.to_string()).unwrap();
    refused(folder.path(), &["transforms.json", "images/0000.png", "twice"]);
}

#[test]
fn transforms_that_cannot_be_used() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_transforms(folder.path());
    let path = folder.path().join("transforms.json");
    let good = std::fs::read_to_string(&path).unwrap();
    let change = |pointer: &str, value: serde_json::Value, words: &[&str]| {
        let mut json: serde_json::Value = serde_json::from_str(&good).unwrap();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        json.pointer_mut(parent).unwrap()[key] = value;
        std::fs::write(&path, json.to_string()).unwrap();
        refused(folder.path(), &[&["transforms.json"], words].concat());
    };
    change("/frames/1/k1", (-9e3).into(), &["0001", "folds the picture over"]);
    change("/camera_model", "EQUIRECTANGULAR".into(), &["EQUIRECTANGULAR", "OPENCV_FISHEYE"]);
    change("/frames/1/fl_x", "wide".into(), &["JSON"]);
    change("/frames/1/transform_matrix", serde_json::json!([[1, 2], [3, 4]]), &["0001.png", "transform_matrix"]);
    let stretched = serde_json::json!([[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    change("/frames/1/transform_matrix", stretched, &["0001.png", "stretch"]);
    change("/frames/1/mask_path", "masks/none.png".into(), &["masks/none.png", "missing"]);
    change("/frames/1/fl_x", 0.0.into(), &["0001.png", "focal length that is not positive"]);
    change("/frames", serde_json::json!([]), &["no frames"]);
    let elsewhere = good.replace("images/", "pictures/");
    std::fs::write(&path, elsewhere).unwrap();
    refused(folder.path(), &["transforms.json", "none of the 9 pictures exists", "pictures/0000.png"]);
    std::fs::write(&path, &good[..good.len() / 2]).unwrap();
    refused(folder.path(), &["transforms.json", "JSON"]);
    std::fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
    refused(folder.path(), &["transforms.json", "JSON"]);
}

#[test]
fn middlebury_lines_that_cannot_be_used() {
    let (ball, folder) = (Ball::new(), tempfile::tempdir().unwrap());
    ball.write_middlebury(folder.path());
    let path = folder.path().join("ballSR_par.txt");
    let good = std::fs::read_to_string(&path).unwrap();
    let change = |text: String, words: &[&str]| {
        std::fs::write(&path, text).unwrap();
        refused(folder.path(), &[&["ballSR_par.txt"], words].concat());
    };
    let lines: Vec<&str> = good.lines().collect();
    change(lines[..5].join("\n"), &["number of the cameras", "(4)"]);
    change(good.replacen(" 0 0 1 ", " 0 NaN 1 ", 1), &["0000.png", "finite numbers"]);
    change(good.replacen(" 0 0 1 ", " 0 0 1 7 ", 1), &["0000.png", "numbers"]);
    let rotation = lines[2].split(' ').nth(10).unwrap();
    change(good.replacen(rotation, "5.5", 1), &["not a rotation"]);
    change(good.replace("0003.png", "0002.png"), &["0002", "twice"]);
}

#[test]
fn shapes_that_do_not_fit() {
    let bad = [
        ("pointcloud.npz", "points", Array::f32(&[4], vec![0.0; 4])),
        ("pointcloud.npz", "points", Array::f32(&[1, 3], vec![0.0, f32::NAN, 0.0])),
        ("points.npz", "occupancies", Array::f32(&[5], vec![0.0; 5])),
        ("points.npz", "points", Array::f32(&[3, 2], vec![0.0; 6])),
    ];
    for (file, name, array) in bad {
        let (_, folder) = dvr();
        let mut arrays = vec![(name.to_owned(), array)];
        if name != "points" {
            arrays.push(("points".to_owned(), Array::f32(&[2, 3], vec![0.1; 6])));
        }
        save(&folder.path().join(file), &arrays);
        refused(folder.path(), &[file, name]);
    }
}
