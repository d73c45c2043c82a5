//! `dvr train` on every layout of posed photographs: the same scene, written as other programs write it.

use std::path::{Path, PathBuf};

use crate::support::{Tiny, dvr, succeeds, text};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::files::{read_mask, read_rgb, write_rgba_png};
use dvr_core::npz::{Array, write_npz};
use dvr_core::{Camera, Scene};
use glam::{DMat3, DMat4, DQuat, DVec3};
use image::{Rgba, RgbaImage};
use serde_json::json;

/// The ring, its cameras in the world, and the files of its views.
struct Photographs {
    tiny: Tiny,
    scene: Scene,
    cameras: Vec<Camera>,
}

impl Photographs {
    fn new() -> Self {
        let tiny = Tiny::new();
        let scene = read_scene(&tiny.scene(), &ReadOptions::default()).unwrap();
        let cameras = scene.views.iter().map(|view| view.camera.into_world(&scene.object_to_world)).collect();
        Self { tiny, scene, cameras }
    }

    /// Copies the pictures and masks into folders of these names.
    fn copy(&self, root: &Path, images: &str, masks: &str) {
        for (from, to) in [("image", images), ("mask", masks)] {
            std::fs::create_dir_all(root.join(to)).unwrap();
            for i in 0..self.cameras.len() {
                let name = format!("{i:04}.png");
                std::fs::copy(self.tiny.scene().join(from).join(&name), root.join(to).join(&name)).unwrap();
            }
        }
    }

    /// Trains with what a user writes, nothing but sizes, and asks for the object in the world of the files.
    fn becomes_the_ring(&self, root: &Path, layout: &str) {
        let described = succeeds(&dvr(&["info", text(root)]));
        assert!(described.contains(layout) && described.contains("24x24"), "{described}");
        let out = root.with_extension("run");
        let small = ["--steps", "20", "--capacity", "32", "--resolution", "32", "--no-report"];
        succeeds(&dvr(&[&["train", text(root), "--out", text(&out)][..], &small].concat()));
        let iou = self.tiny.volume_iou(&out.join("mesh.ply"));
        println!("{layout}: volume IoU {iou:.3}");
        assert!(iou > 0.88, "{layout}: {iou}");
    }

    fn folder(&self, name: &str) -> PathBuf {
        let root = self.tiny.path(name);
        std::fs::create_dir(&root).unwrap();
        root
    }
}

/// With pixel centres at integers, as IDR and Middlebury count.
fn centred(camera: &Camera) -> DMat3 {
    let mut intrinsics = camera.intrinsics;
    intrinsics.z_axis -= DVec3::new(0.5, 0.5, 0.0);
    intrinsics
}

fn rows(matrix: DMat3) -> Vec<String> {
    matrix.transpose().to_cols_array().iter().map(f64::to_string).collect()
}

#[test]
fn colmap() {
    let photographs = Photographs::new();
    let root = photographs.folder("colmap");
    photographs.copy(&root, "images", "masks");
    let model = root.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    let (mut cameras, mut images) = (String::from("# cameras\n"), String::from("# images\n"));
    for (i, camera) in photographs.cameras.iter().enumerate() {
        let k = camera.intrinsics;
        let id = i + 1;
        cameras += &format!("{id} PINHOLE 24 24 {} {} {} {}\n", k.x_axis.x, k.y_axis.y, k.z_axis.x, k.z_axis.y);
        let (q, t) = (DQuat::from_mat3(&camera.rotation), camera.translation);
        images += &format!("{id} {} {} {} {} {} {} {} {id} {i:04}.png\n\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
    }
    std::fs::write(model.join("cameras.txt"), cameras).unwrap();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), "# no points\n").unwrap();
    photographs.becomes_the_ring(&root, "COLMAP");
}

#[test]
fn nerf() {
    let photographs = Photographs::new();
    let root = photographs.folder("nerf");
    std::fs::create_dir(root.join("train")).unwrap();
    let mut frames = Vec::new();
    for (i, camera) in photographs.cameras.iter().enumerate() {
        // RGBA, whose alpha channel is the mask.
        let [image, mask] = ["image", "mask"].map(|part| photographs.tiny.scene().join(format!("{part}/{i:04}.png")));
        let (image, mask) = (read_rgb(&image).unwrap(), read_mask(&mask).unwrap());
        let picture = RgbaImage::from_fn(24, 24, |u, v| {
            let [r, g, b] = image.get_pixel(u, v).0;
            Rgba([r, g, b, mask.coverage.get_pixel(u, v).0[0]])
        });
        write_rgba_png(&root.join(format!("train/r_{i}.png")), &picture).unwrap();
        let to_world = camera.world_to_camera().inverse() * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        let rows: Vec<[f64; 4]> = (0..4).map(|row| to_world.row(row).to_array()).collect();
        frames.push(json!({ "file_path": format!("./train/r_{i}"), "transform_matrix": rows }));
    }
    let angle = 2.0 * (12.0 / photographs.cameras[0].intrinsics.x_axis.x).atan();
    let file = json!({ "camera_angle_x": angle, "frames": frames });
    std::fs::write(root.join("transforms_train.json"), file.to_string()).unwrap();
    photographs.becomes_the_ring(&root, "transforms");
}

#[test]
fn idr() {
    let photographs = Photographs::new();
    let root = photographs.folder("idr");
    photographs.copy(&root, "image", "mask");
    let matrix = |matrix: DMat4| Array::f64(&[4, 4], matrix.transpose().to_cols_array().to_vec());
    let to_world = &photographs.scene.object_to_world;
    let sphere = DMat4::from_translation(to_world.translation) * DMat4::from_scale(DVec3::splat(0.6 * to_world.scale));
    let mut arrays = Vec::new();
    for (i, camera) in photographs.cameras.iter().enumerate() {
        let projection = DMat4::from_mat3(centred(camera)) * camera.world_to_camera();
        arrays.push((format!("world_mat_{i}"), matrix(projection)));
        arrays.push((format!("scale_mat_{i}"), matrix(sphere)));
    }
    let arrays: Vec<_> = arrays.iter().map(|(name, array)| (name.as_str(), array)).collect();
    write_npz(&root.join("cameras_sphere.npz"), &arrays).unwrap();
    photographs.becomes_the_ring(&root, "IDR");
}

#[test]
fn middlebury() {
    let photographs = Photographs::new();
    let root = photographs.folder("middlebury");
    photographs.copy(&root, ".", "mask");
    let mut lines = format!("{}\n", photographs.cameras.len());
    for (i, camera) in photographs.cameras.iter().enumerate() {
        let numbers = [rows(centred(camera)), rows(camera.rotation)].concat().join(" ");
        let t = camera.translation;
        lines += &format!("{i:04}.png {numbers} {} {} {}\n", t.x, t.y, t.z);
    }
    std::fs::write(root.join("ring_par.txt"), lines).unwrap();
    photographs.becomes_the_ring(&root, "Middlebury");
}
