//! Cameras as `transforms.json`, for other programs.

use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::files::write_bytes_atomically;

#[derive(Serialize)]
struct Transforms<'a> {
    camera_model: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    ply_file_path: Option<&'a str>,
    frames: Vec<Frame<'a>>,
}

#[derive(Serialize)]
struct Frame<'a> {
    file_path: &'a str,
    w: u32,
    h: u32,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    transform_matrix: [[f64; 4]; 4],
}

/// Writes cameras, each with the path of its picture beside the file, as nerfstudio's `transforms.json`: intrinsics in
/// each frame, camera to world with y up and a view along -z. Skew, which the format does not know, is left out. `points`
/// is the path of a PLY file with sparse points, where there is one.
///
/// # Errors
/// When the file cannot be written.
pub fn write_transforms<'a>(
    path: &Path,
    cameras: impl IntoIterator<Item = (&'a str, &'a Camera)>,
    points: Option<&'a str>,
) -> Result<()> {
    let frames = cameras.into_iter().map(|(file_path, camera)| frame(file_path, camera)).collect();
    let text = serde_json::to_string_pretty(&Transforms { camera_model: "PINHOLE", ply_file_path: points, frames })
        .map_err(|e| Error::format(path, e.to_string(), "Report this."))?;
    write_bytes_atomically(path, text.as_bytes())
}

fn frame<'a>(file_path: &'a str, camera: &Camera) -> Frame<'a> {
    let to_world = camera.rotation.transpose();
    let columns = [to_world.x_axis, -to_world.y_axis, -to_world.z_axis, camera.center()];
    let row = |of: fn(&DVec3) -> f64| [of(&columns[0]), of(&columns[1]), of(&columns[2]), of(&columns[3])];
    let intrinsics = &camera.intrinsics;
    Frame {
        file_path,
        w: camera.width,
        h: camera.height,
        fl_x: intrinsics.x_axis.x,
        fl_y: intrinsics.y_axis.y,
        cx: intrinsics.z_axis.x,
        cy: intrinsics.z_axis.y,
        transform_matrix: [row(|c| c.x), row(|c| c.y), row(|c| c.z), [0.0, 0.0, 0.0, 1.0]],
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::dataset::{Normalise, ReadOptions, read_scene};
    use crate::files::write_rgb_png;

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let eyes = [DVec3::new(2.0, 0.3, -0.4), DVec3::new(-1.0, 1.5, 0.9), DVec3::new(0.1, -0.7, 2.0)];
        let cameras = eyes.map(|eye| Camera::look_at(40, 30, 35.0, eye, DVec3::ZERO, DVec3::Y));
        let names = ["a", "b", "c"];
        for name in names {
            let picture =
                RgbImage::from_fn(40, 30, |u, v| Rgb([if (10..30).contains(&u) && v > 9 { 9 } else { 250 }; 3]));
            write_rgb_png(&folder.path().join(format!("{name}.png")), &picture).unwrap();
        }
        let file = folder.path().join("transforms.json");
        write_transforms(&file, names.into_iter().zip(&cameras), None).unwrap();
        let options = ReadOptions {
            background: Some(crate::dataset::Background::of(crate::dataset::BackgroundColor::White)),
            normalise: Normalise::Given(crate::Similarity::default()),
            ..ReadOptions::default()
        };
        let scene = read_scene(&file, &options).unwrap();
        for (view, camera) in scene.views.iter().zip(&cameras) {
            assert!((view.camera.center() - camera.center()).length() < 1e-9);
            assert!((view.camera.forward() - camera.forward()).length() < 1e-9);
            let difference = view.camera.intrinsics - camera.intrinsics;
            assert!(difference.to_cols_array().iter().all(|x| x.abs() < 1e-9));
        }
    }
}
