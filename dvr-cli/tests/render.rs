//! `dvr render`: pictures of a mesh, and the cameras beside them.

mod support;

use std::path::{Path, PathBuf};

use dvr_core::files::read_rgb;
use dvr_core::mesh::{Mesh, shapes, write_mesh};
use support::{Tiny, dvr, refuses, succeeds, text};

/// A ball in the world, red in front (+z), blue behind.
fn ball(folder: &Path) -> PathBuf {
    let ball = shapes::icosphere(3, 2.0);
    let color = |z: f32| if z > 0.0 { [0.8, 0.1, 0.1] } else { [0.1, 0.1, 0.8] };
    let colors = Some(ball.vertices.iter().map(|vertex| color(vertex.z)).collect());
    let path = folder.join("ball.glb");
    write_mesh(&path, &Mesh { colors, ..ball }).unwrap();
    path
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.filter(|name| !name.contains("dvr-folder")).collect();
    names.sort();
    names
}

/// The middle pixel of a picture.
fn middle(picture: &Path) -> [u8; 3] {
    let picture = read_rgb(picture).unwrap();
    picture.get_pixel(picture.width() / 2, picture.height() / 2).0
}

#[test]
fn a_mesh_is_rendered_and_its_cameras_stand_in_its_own_world() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, out) = (ball(folder.path()), folder.path().join("frames"));
    let render = ["render", text(&mesh), "--out", text(&out), "--frames", "4", "--size", "32", "--elevation", "0"];
    succeeds(&dvr(&[&render[..], &["--animation", "none"]].concat()));
    let frames = ["orbit_0000.png", "orbit_0001.png", "orbit_0002.png", "orbit_0003.png", "transforms.json"];
    assert_eq!(names(&out), frames);
    let cameras: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("transforms.json")).unwrap()).unwrap();
    let mut seen = [0, 0];
    for frame in cameras["frames"].as_array().unwrap() {
        let number = |row: usize, column: usize| frame["transform_matrix"][row][column].as_f64().unwrap();
        // The eye looks at the middle along -z of the camera: the column points from the middle to the eye.
        let eye = [0, 1, 2].map(|row| number(row, 3));
        let distance = eye.iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..3).for_each(|row| assert!((number(row, 2) - eye[row] / distance).abs() < 1e-6));
        // 2.2 edges of a cube of which the ball's diameter of 4 fills .9.
        assert!((distance - 2.2 * 4.0 / 0.9).abs() < 1e-3 && eye[1].abs() < 1e-6, "{eye:?}");
        let [r, _, b] = middle(&out.join(frame["file_path"].as_str().unwrap()));
        if eye[2].abs() > 0.5 * distance {
            assert_eq!(r > b, eye[2] > 0.0, "the side that the camera stands on");
            seen[usize::from(eye[2] > 0.0)] += 1;
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "{seen:?}");
    refuses(&dvr(&[&render[..], &["--overwrite", "--cameras", "dataset"]].concat()), &["--data"]);
    refuses(&dvr(&[&render[..], &["--overwrite", "--object", "1"]].concat()), &["--object", "mesh"]);
}

#[test]
fn a_mesh_with_its_scene_is_seen_by_the_scenes_cameras() {
    let tiny = Tiny::rendered(shapes::torus(1.0, 0.45, 32, 16), 12, 48);
    let (scene, mesh, out) = (tiny.scene(), tiny.path("torus.ply"), tiny.path("frames"));
    let torus = shapes::torus(1.0, 0.45, 32, 16);
    write_mesh(&mesh, &Mesh { colors: Some(vec![[0.4; 3]; torus.vertices.len()]), ..torus }).unwrap();
    let render = ["render", text(&mesh), "--out", text(&out), "--data", text(&scene), "--cameras", "dataset"];
    succeeds(&dvr(&render));
    assert_eq!(names(&out).len(), 13);
    let (mut same, mut all) = (0, 0);
    for i in 0..12 {
        let rendered = read_rgb(&out.join(format!("{i:04}.png"))).unwrap();
        let mask = read_rgb(&scene.join(format!("mask/{i:04}.png"))).unwrap();
        for (u, v, mask) in mask.enumerate_pixels() {
            all += 1;
            same += usize::from((mask.0[0] > 127) == (rendered.get_pixel(u, v).0 != [255; 3]));
        }
    }
    assert!(same * 1000 > all * 970, "{same} of {all} pixels");
}
