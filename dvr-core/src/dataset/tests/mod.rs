//! A small scene with known answers, written in every layout by the tests themselves.

mod bad_input;
mod colmap_models;
mod digests;
mod fixtures;
mod formats;
mod known_scenes;
mod lenses;
mod object_datasets;
mod options;
mod points_files;

use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec2, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::*;
use crate::camera::{Camera, Similarity};
use crate::files::{write_depth_exr, write_gray_png, write_rgb_png};
use crate::npz::{Array, NpzFile, write_npz};
use crate::raster::{DepthMap, Mask};
use crate::scene::Scene;

const WIDTH: u32 = 48;
const HEIGHT: u32 = 36;

/// A ball somewhere in a world of millimetres, and cameras all around it.
struct Ball {
    center: DVec3,
    radius: f64,
    cameras: Vec<Camera>,
}

impl Ball {
    fn new() -> Self {
        let (center, radius) = (DVec3::new(12.0, -40.0, 310.0), 25.0);
        let cameras = (0..9)
            .map(|i| {
                let (turn, height) = (0.7 * f64::from(i), [-0.5, 0.2, 0.7][i as usize % 3]);
                let side = DVec3::new(turn.cos(), height, turn.sin()).normalize();
                let mut camera = Camera::look_at(WIDTH, HEIGHT, 60.0, center + 130.0 * side, center, DVec3::Y);
                // Nothing is in the middle, and pixels are not square.
                camera.intrinsics.z_axis.x += 0.3 * f64::from(i) - 1.0;
                camera.intrinsics.z_axis.y -= 1.7;
                camera.intrinsics.y_axis.y *= 1.02;
                camera
            })
            .collect();
        Self { center, radius, cameras }
    }

    fn object_to_world(&self) -> Similarity {
        Similarity { scale: 2.4 * self.radius, translation: self.center, ..Similarity::default() }
    }

    /// z-depth in world units of the ball at pixel coordinates.
    fn z_depth(&self, camera: &Camera, pixel: DVec2) -> Option<f64> {
        let ray = camera.ray(pixel);
        let to = ray.origin - self.center;
        let (a, b) = (ray.direction.length_squared(), to.dot(ray.direction));
        let discriminant = b * b - a * (to.length_squared() - self.radius.powi(2));
        (discriminant >= 0.0).then(|| (-b - discriminant.sqrt()) / a)
    }

    fn depth(&self, camera: &Camera) -> DepthMap {
        let pixels = (0..HEIGHT).flat_map(|v| (0..WIDTH).map(move |u| DVec2::new(u.into(), v.into()) + 0.5));
        let z_depth = pixels.map(|p| self.z_depth(camera, p).map_or(f32::INFINITY, |z| z as f32)).collect();
        DepthMap { width: WIDTH, height: HEIGHT, z_depth }
    }

    fn mask(&self, camera: &Camera) -> Mask {
        let depth = self.depth(camera);
        let coverage = |u, v| Luma([if depth.get(u, v).is_finite() { 255 } else { 0 }]);
        Mask::from(GrayImage::from_fn(WIDTH, HEIGHT, coverage))
    }

    fn image(&self, camera: &Camera) -> RgbImage {
        let depth = self.depth(camera);
        RgbImage::from_fn(WIDTH, HEIGHT, |u, v| {
            Rgb(if depth.get(u, v).is_finite() { [180, u as u8, v as u8] } else { [255; 3] })
        })
    }

    /// Writes images, and masks where a folder for them is given, and returns the names of the images.
    fn write_images(&self, images: &Path, masks: Option<&Path>) -> Vec<PathBuf> {
        for folder in [Some(images), masks].into_iter().flatten() {
            std::fs::create_dir_all(folder).unwrap();
        }
        let names: Vec<PathBuf> = (0..self.cameras.len()).map(|i| format!("{i:04}.png").into()).collect();
        for (camera, name) in self.cameras.iter().zip(&names) {
            write_rgb_png(&images.join(name), &self.image(camera)).unwrap();
            if let Some(masks) = masks {
                write_gray_png(&masks.join(name), &self.mask(camera).coverage).unwrap();
            }
        }
        names
    }

    /// Writes the DVR layout.
    fn write_dvr(&self, root: &Path) {
        let names = self.write_images(&root.join("image"), Some(&root.join("mask")));
        std::fs::create_dir_all(root.join("depth")).unwrap();
        let mut arrays = Vec::new();
        for (i, (camera, name)) in self.cameras.iter().zip(&names).enumerate() {
            write_depth_exr(&root.join("depth").join(name).with_extension("exr"), &self.depth(camera)).unwrap();
            let (half_width, half_height) = (0.5 * f64::from(WIDTH), 0.5 * f64::from(HEIGHT));
            let normalised = DMat3::from_cols(
                DVec3::new(1.0 / half_width, 0.0, 0.0),
                DVec3::new(0.0, 1.0 / half_height, 0.0),
                DVec3::new(-1.0, -1.0, 1.0),
            );
            arrays.push((format!("camera_mat_{i}"), matrix(&DMat4::from_mat3(normalised * camera.intrinsics))));
            arrays.push((format!("world_mat_{i}"), matrix(&camera.world_to_camera())));
            arrays.push((format!("scale_mat_{i}"), matrix(&self.object_to_world().to_matrix())));
        }
        save(&root.join("cameras.npz"), &arrays);
    }

    /// Writes the IDR layout, with pixel centres at integers.
    fn write_idr(&self, root: &Path) {
        self.write_images(&root.join("image"), Some(&root.join("mask")));
        let mut arrays = Vec::new();
        for (i, camera) in self.cameras.iter().enumerate() {
            let mut k = camera.intrinsics;
            k.z_axis -= DVec3::new(0.5, 0.5, 0.0);
            let p = DMat4::from_mat3(k) * camera.world_to_camera();
            arrays.push((format!("world_mat_{i}"), matrix(&p)));
            let sphere = DMat4::from_scale_rotation_translation(
                DVec3::splat(1.3 * self.radius),
                glam::DQuat::IDENTITY,
                self.center,
            );
            arrays.push((format!("scale_mat_{i}"), matrix(&sphere)));
        }
        save(&root.join("cameras_sphere.npz"), &arrays);
    }

    /// Writes the Middlebury layout.
    fn write_middlebury(&self, root: &Path) {
        let names = self.write_images(root, Some(&root.join("mask")));
        let mut text = format!("{}\n", names.len());
        for (camera, name) in self.cameras.iter().zip(&names) {
            let mut k = camera.intrinsics;
            k.z_axis -= DVec3::new(0.5, 0.5, 0.0);
            let numbers = [k, camera.rotation].into_iter().flat_map(|m| m.transpose().to_cols_array());
            let numbers: Vec<String> = numbers.chain(camera.translation.to_array()).map(|x| x.to_string()).collect();
            text += &format!("{} {}\n", name.display(), numbers.join(" "));
        }
        std::fs::write(root.join("ballSR_par.txt"), text).unwrap();
    }

    /// A frame of a transforms file.
    fn frame(&self, camera: &Camera, file_path: &str) -> serde_json::Value {
        let to_world = camera.world_to_camera().inverse() * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        let rows: Vec<[f64; 4]> = (0..4).map(|i| to_world.row(i).to_array()).collect();
        let k = camera.intrinsics;
        serde_json::json!({
            "file_path": file_path, "transform_matrix": rows,
            "fl_x": k.x_axis.x, "fl_y": k.y_axis.y, "cx": k.z_axis.x, "cy": k.z_axis.y, "w": WIDTH, "h": HEIGHT,
        })
    }

    /// Writes the nerfstudio layout.
    fn write_transforms(&self, root: &Path) {
        let names = self.write_images(&root.join("images"), Some(&root.join("masks")));
        let frame = |(camera, name): (&Camera, &PathBuf)| self.frame(camera, &format!("images/{}", name.display()));
        let frames: Vec<_> = self.cameras.iter().zip(&names).map(frame).collect();
        std::fs::write(root.join("transforms.json"), serde_json::json!({ "frames": frames }).to_string()).unwrap();
    }

    /// Whether the scene has the cameras of this one: points of the world fall on the same pixels, at the same depth.
    fn assert_same_cameras(&self, scene: &Scene) {
        let world_to_object = scene.object_to_world.inverse();
        for (view, camera) in scene.views.iter().zip(&self.cameras) {
            for offset in [DVec3::ZERO, DVec3::X, DVec3::new(-0.4, 0.7, 0.2)] {
                let world = self.center + self.radius * offset;
                let (pixel, z) = view.camera.project(world_to_object.transform_point(world));
                let (expected, expected_z) = camera.project(world);
                assert!((pixel - expected).length() < 1e-4, "{}: {pixel} is not {expected}", view.name);
                assert!((z * scene.object_to_world.scale - expected_z).abs() < 1e-4 * expected_z);
            }
        }
    }

    /// Whether the object lies in the unit cube and fills most of it.
    fn assert_in_cube(&self, scene: &Scene) {
        let center = scene.object_to_world.inverse().transform_point(self.center);
        let radius = self.radius / scene.object_to_world.scale;
        assert!(center.abs().max_element() + radius < 0.5, "center {center}, radius {radius}");
        assert!(radius > 0.35, "radius {radius}");
    }
}

/// A matrix as NumPy stores it.
fn matrix(matrix: &DMat4) -> Array {
    Array::f64(&[4, 4], matrix.transpose().to_cols_array().to_vec())
}

fn save(path: &Path, arrays: &[(String, Array)]) {
    let arrays: Vec<_> = arrays.iter().map(|(name, array)| (name.as_str(), array)).collect();
    write_npz(path, &arrays).unwrap();
}

fn read(path: &Path) -> Scene {
    read_scene(path, &ReadOptions::default()).unwrap()
}
