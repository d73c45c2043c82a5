//! Cameras of every layout, for three pictures of a box.

use std::path::Path;

use dvr_core::Camera;
use dvr_core::dataset::write_transforms;
use dvr_core::npz::{Array, Values};
use glam::{DMat3, DMat4, DQuat, DVec3};

use super::arrays::{npy_of, npz_of};
use super::pictures::picture;
use super::written;
use crate::fuzz::parts;

const NAMES: [&str; 3] = ["000", "001", "002"];
const SIZE: (u32, u32) = (12, 8);

fn cameras() -> [Camera; 3] {
    let eyes = [DVec3::new(2.0, 0.3, -0.4), DVec3::new(-1.0, 1.5, 0.9), DVec3::new(0.1, -0.7, 2.0)];
    eyes.map(|eye| Camera::look_at(SIZE.0, SIZE.1, 12.0, eye, DVec3::ZERO, DVec3::Y))
}

fn made(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
}

/// Three pictures with alpha, in `images/` and beside it.
pub(in crate::fuzz) fn put_pictures(folder: &Path) {
    made(&folder.join("images"));
    for place in [folder.to_owned(), folder.join("images")] {
        for name in NAMES {
            let path = place.join(format!("{name}.png"));
            picture(SIZE.0, SIZE.1).save(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        }
    }
}

/// Pictures and sound cameras.
pub(in crate::fuzz) fn put_object(folder: &Path) {
    put_pictures(folder);
    let cameras = cameras_npz().remove(0);
    std::fs::write(folder.join("cameras.npz"), cameras).unwrap_or_else(|e| panic!("{e}"));
}

/// A dataset of two objects; only their folders matter to lists.
pub(in crate::fuzz) fn put_objects(folder: &Path) {
    ["a", "b"].iter().for_each(|name| made(&folder.join("chairs").join(name)));
}

pub(in crate::fuzz) fn transforms() -> Vec<Vec<u8>> {
    let names = NAMES.map(|name| format!("{name}.png"));
    let ours = written("transforms.json", |path| {
        let cameras = cameras();
        write_transforms(path, names.iter().map(String::as_str).zip(&cameras), None).unwrap_or_else(|e| panic!("{e}"));
    });
    let frame = |i: usize, camera: &Camera| {
        let to_world = DMat4::from_rotation_translation(
            DQuat::from_mat3(&(camera.rotation.transpose() * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)))),
            camera.center(),
        );
        let rows: Vec<String> = (0..4).map(|r| format!("{:?}", to_world.row(r).to_array())).collect();
        format!(r#"{{"file_path": "./{}", "transform_matrix": [{}]}}"#, NAMES[i], rows.join(", "))
    };
    let frames: Vec<String> = cameras().iter().enumerate().map(|(i, camera)| frame(i, camera)).collect();
    let nerf = format!(
        "{{\"camera_angle_x\": 0.9273, \"val_filenames\": [\"./002\"],\n\"frames\": [\n{}]}}",
        frames.join(",\n")
    );
    vec![ours, nerf.into_bytes()]
}

/// Rotation as `w x y z` and translation, world to camera.
fn pose(camera: &Camera) -> ([f64; 4], [f64; 3]) {
    let rotation = DQuat::from_mat3(&camera.rotation);
    let translation = -(camera.rotation * camera.center());
    ([rotation.w, rotation.x, rotation.y, rotation.z], translation.to_array())
}

pub(in crate::fuzz) fn colmap_text() -> Vec<Vec<u8>> {
    let size = format!("{} {}", SIZE.0, SIZE.1);
    let pinhole = format!("# cameras\n1 PINHOLE {size} 12 12 6 4\n");
    let distorted =
        format!("# cameras\n1 THIN_PRISM_FISHEYE {size} 12 12 6 4 0.1 0.02 0.01 -0.01 0.003 0.001 0.002 0.001\n");
    let mut images = String::from("# images\n");
    for (i, camera) in cameras().iter().enumerate() {
        let ([w, x, y, z], [a, b, c]) = pose(camera);
        images += &format!("{} {w} {x} {y} {z} {a} {b} {c} 1 {}.png\n1.5 2.5 1\n", i + 1, NAMES[i]);
    }
    let points = "# points\n1 0.1 0.2 0 255 0 0 0.5 1 0 2 0\n2 -0.1 0 0.1 0 9 0 0.5 2 1 3 0\n";
    let model = |cameras: &str| {
        let texts = [("cameras.txt", cameras), ("images.txt", images.as_str()), ("points3D.txt", points)];
        parts::joined(&texts.map(|(name, text)| (name, text.as_bytes())))
    };
    vec![model(&pinhole), model(&distorted)]
}

pub(in crate::fuzz) fn colmap_binary() -> Vec<Vec<u8>> {
    let numbers = |values: &[f64]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let mut cameras_bin = [1u64.to_le_bytes().to_vec(), [1u32, 1].map(u32::to_le_bytes).concat()].concat();
    cameras_bin.extend([u64::from(SIZE.0), u64::from(SIZE.1)].map(u64::to_le_bytes).concat());
    cameras_bin.extend(numbers(&[12.0, 12.0, 6.0, 4.0]));
    let mut images = 3u64.to_le_bytes().to_vec();
    for (i, camera) in cameras().iter().enumerate() {
        let (rotation, translation) = pose(camera);
        images.extend((i as u32 + 1).to_le_bytes());
        images.extend(numbers(&rotation));
        images.extend(numbers(&translation));
        images.extend(1u32.to_le_bytes());
        images.extend(format!("{}.png\0", NAMES[i]).as_bytes());
        images.extend(1u64.to_le_bytes());
        images.extend(numbers(&[1.5, 2.5]));
        images.extend(1u64.to_le_bytes());
    }
    let mut points = [1u64, 1].map(u64::to_le_bytes).concat();
    points.extend(numbers(&[0.1, 0.2, 0.0]));
    points.extend([255, 0, 0]);
    points.extend(numbers(&[0.5]));
    points.extend(2u64.to_le_bytes());
    points.extend([1u32, 0, 2, 0].map(u32::to_le_bytes).concat());
    vec![parts::joined(&[("cameras.bin", &cameras_bin), ("images.bin", &images), ("points3D.bin", &points)])]
}

pub(in crate::fuzz) fn middlebury() -> Vec<Vec<u8>> {
    let mut text = String::from("3\n");
    for (name, camera) in NAMES.iter().zip(cameras()) {
        let rows = |m: &DMat3| m.transpose().to_cols_array().map(|x| x.to_string()).join(" ");
        let (_, translation) = pose(&camera);
        let translation = translation.map(|x| x.to_string()).join(" ");
        text += &format!("{name}.png {} {} {translation}\n", rows(&camera.intrinsics), rows(&camera.rotation));
    }
    vec![text.into_bytes()]
}

pub(in crate::fuzz) fn llff() -> Vec<Vec<u8>> {
    let row = |camera: &Camera| {
        let [right, down, forward] = [0, 1, 2].map(|axis| camera.rotation.row(axis));
        let size = DVec3::new(f64::from(SIZE.1), f64::from(SIZE.0), 12.0);
        let columns = [down, right, -forward, camera.center(), size];
        let matrix = (0..3).flat_map(move |axis| columns.map(|column| column[axis]));
        matrix.chain([1.0, 4.0]).collect::<Vec<f64>>()
    };
    let numbers: Vec<u8> = cameras().iter().flat_map(row).flat_map(f64::to_le_bytes).collect();
    vec![npy_of("<f8", false, "(3, 17)", &numbers)]
}

/// In the layout of DVR, and in that of IDR.
pub(in crate::fuzz) fn cameras_npz() -> Vec<Vec<u8>> {
    let array = |m: &DMat4| Array::f64(&[4, 4], m.transpose().to_cols_array().to_vec());
    let (mut dvr, mut idr) = (Vec::new(), Vec::new());
    for (i, camera) in cameras().iter().enumerate() {
        let half = [f64::from(SIZE.0) / 2.0, f64::from(SIZE.1) / 2.0];
        let to_unit = DMat3::from_cols(DVec3::X / half[0], DVec3::Y / half[1], DVec3::new(-1.0, -1.0, 1.0));
        let (k, world) = (camera.intrinsics, camera.world_to_camera());
        dvr.push((format!("camera_mat_{i}"), array(&DMat4::from_mat3(to_unit * k))));
        dvr.push((format!("world_mat_{i}"), array(&world)));
        dvr.push((format!("scale_mat_{i}"), array(&DMat4::IDENTITY)));
        idr.push((format!("world_mat_{i}"), array(&(DMat4::from_mat3(k) * world))));
        idr.push((format!("scale_mat_{i}"), array(&DMat4::IDENTITY)));
    }
    [dvr, idr]
        .map(|arrays| {
            let arrays: Vec<_> = arrays.iter().map(|(name, array)| (name.as_str(), array.clone())).collect();
            npz_of(&arrays)
        })
        .into()
}

pub(in crate::fuzz) fn object_npz() -> Vec<Vec<u8>> {
    let points = Array::f32(&[4, 3], (0..12).map(|i| 0.05 * (i as f32 - 6.0)).collect());
    let indices = |values: &[i64]| Array { shape: vec![values.len()], values: Values::I64(values.to_vec()) };
    let truths = Array { shape: vec![4], values: Values::Bool(vec![true, true, false, true]) };
    let colors = Array { shape: vec![4, 3], values: Values::U8(vec![200; 12]) };
    let packed = Array { shape: vec![1], values: Values::U8(vec![0b1010_0000]) };
    let pcl = npz_of(&[
        ("points", points.clone()),
        ("visibility_0000", indices(&[0, 3])),
        ("visibility_0001", truths.clone()),
        ("colors", colors),
        ("is_in_visual_hull", truths),
    ]);
    let occupancy = npz_of(&[("points", points.clone()), ("occupancies", packed)]);
    let cloud = npz_of(&[("points", points.clone()), ("normals", points)]);
    vec![parts::joined(&[("pcl.npz", &pcl), ("points.npz", &occupancy), ("pointcloud.npz", &cloud)])]
}

pub(in crate::fuzz) fn object_lists() -> Vec<Vec<u8>> {
    let yaml = "chairs:\n  id: chairs\n  name: chair\n\"03001627\":\n  id: \"03001627\"\n  name: 'other'\n";
    let texts = [("metadata.yaml", yaml), ("train.lst", "a\nb\n"), ("val.lst", "b\n"), ("test.lst", "a\n")];
    vec![parts::joined(&texts.map(|(name, text)| (name, text.as_bytes())))]
}
