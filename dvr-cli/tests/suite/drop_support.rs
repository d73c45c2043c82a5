//! `--drop-support`: the mesh is cut by the plane that the object was found to stand on.

use std::path::{Path, PathBuf};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::dataset::write_transforms;
use dvr_core::files::write_rgb_png;
use dvr_core::mesh::{Mesh, read_mesh};
use dvr_core::{Camera, HalfSpace};
use glam::DVec3;
use image::{Rgb, RgbImage};
use serde_json::Value;

const RADIUS: f64 = 0.2;
const SIDE: u32 = 100;

/// Blotches: a value from 0 to 1 that changes from cell to cell.
fn blotch(at: DVec3, cell: f64) -> f64 {
    let [x, y, z] = (at / cell).floor().to_array().map(|c| c as i64 as u64);
    let mixed = (x.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F))
        .wrapping_add(z.wrapping_mul(0x1656_67B1_9E37_79F9));
    ((mixed ^ (mixed >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 40) as f64 / f64::from(1 << 24)
}

/// What a ray shows: a ball around the origin, the table that it stands on, or what is beyond.
fn shown(origin: DVec3, direction: DVec3) -> [f64; 3] {
    let along = -origin.dot(direction);
    let missed = (origin + along * direction).length_squared();
    if missed < RADIUS * RADIUS {
        let value = blotch(origin + (along - (RADIUS * RADIUS - missed).sqrt()) * direction, 0.04);
        return [0.5 + 0.4 * value, 0.3 + 0.3 * value, 0.2];
    }
    let at = origin + (-RADIUS - origin.z) / direction.z * direction;
    if direction.z > 0.0 || at.length() > 2.0 { [0.05, 0.05, 0.08] } else { [0.2, 0.3 + 0.4 * blotch(at, 0.06), 0.6] }
}

/// A ball on a table, photographed from above only, without masks.
fn ball_on_a_table(folder: &Path) -> PathBuf {
    let scene = folder.join("scene");
    std::fs::create_dir_all(scene.join("images")).unwrap();
    let cameras: Vec<(String, Camera)> = (0..24)
        .map(|i| {
            let (turn, height) = (f64::from(i) / 24.0 * std::f64::consts::TAU, if i % 2 == 0 { 0.5 } else { 0.9 });
            let eye = DVec3::new(1.2 * turn.cos(), 1.2 * turn.sin(), height);
            let camera = Camera::look_at(SIDE, SIDE, 1.6 * f64::from(SIDE), eye, DVec3::ZERO, DVec3::Z);
            let picture = RgbImage::from_fn(SIDE, SIDE, |u, v| {
                let samples = (0..4u32).map(|k| {
                    let ray = camera.ray(glam::DVec2::new(
                        f64::from(u) + 0.25 + 0.5 * f64::from(k % 2),
                        f64::from(v) + 0.25 + 0.5 * f64::from(k / 2),
                    ));
                    DVec3::from_array(shown(ray.origin, ray.direction.normalize()))
                });
                let mean = samples.sum::<DVec3>() / 4.0;
                Rgb(mean.to_array().map(|c| (255.0 * c) as u8))
            });
            let name = format!("images/{i:02}.png");
            write_rgb_png(&scene.join(&name), &picture).unwrap();
            (name, camera)
        })
        .collect();
    let named = cameras.iter().map(|(name, camera)| (name.as_str(), camera));
    write_transforms(&scene.join("transforms.json"), named, None).unwrap();
    scene
}

fn mesh_of(path: &Path) -> Mesh {
    read_mesh(path).unwrap().mesh
}

/// How far a mesh reaches behind a plane.
fn behind(mesh: &Mesh, half: &HalfSpace) -> f64 {
    -mesh.vertices.iter().map(|&vertex| half.distance(vertex)).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_mesh_is_cut_by_the_table_and_closed() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, run) = (ball_on_a_table(folder.path()), folder.path().join("run"));
    let train = ["train", text(&scene), "--out", text(&run), "--method", "hull", "--resolution", "48"];
    let output = dvr(&[&train[..], &["--texture", "off", "--drop-support"]].concat());
    let said = succeeds(&output) + &String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("it stands on a plane, which is not part of it (normal ("), "{said}");
    assert!(said.contains("support plane: normal (") && said.contains("the mesh is cut by it"), "{said}");
    let metrics: Value = serde_json::from_str(&std::fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap();
    let half: HalfSpace = serde_json::from_value(metrics["support"]["plane"].clone()).unwrap();
    assert!(half.normal.z > 0.999 && (half.offset + RADIUS).abs() < 0.02, "in the files' world: {half:?}");
    assert!(std::fs::read_to_string(run.join("report.html")).unwrap().contains("Support plane"));
    let cut = mesh_of(&run.join("mesh.ply"));
    assert!(behind(&cut, &half) < 1e-4 && cut.open_edges() == 0, "{} behind", behind(&cut, &half));
    let colors = cut.colors.as_ref().unwrap();
    let cap: Vec<usize> = (0..cut.vertices.len()).filter(|&i| half.distance(cut.vertices[i]) < 1e-4).collect();
    assert!(cap.len() > 8 && cap.iter().all(|&i| colors[i][0] > colors[i][2]), "the ball is redder than blue");
    // Again by itself; and without the option there is something to cut off.
    let again = folder.path().join("again.ply");
    succeeds(&dvr(&["mesh", text(&run), "--resolution", "48", "--texture", "off", "--out", text(&again)]));
    assert_eq!(mesh_of(&again).faces, cut.faces);
    let masks = run.join("masks");
    let whole = folder.path().join("whole");
    let args = ["train", text(&scene), "--out", text(&whole), "--method", "hull", "--resolution", "48"];
    succeeds(&dvr(&[&args[..], &["--texture", "off", "--no-report", "--masks", text(&masks)]].concat()));
    assert!(behind(&mesh_of(&whole.join("mesh.ply")), &half) > 0.01);
    let resume = ["train", "--resume", "--out", text(&whole), "--drop-support"];
    refuses(&dvr(&resume), &["--drop-support was off, is on"]);
}

#[test]
fn without_masks_from_all_views_there_is_no_plane_to_cut_by() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let train = |more: &[&str]| dvr(&[&["train", text(&scene), "--out", text(&run), "--drop-support"], more].concat());
    refuses(&train(&[]), &["--drop-support", "masks from all views", "Leave it out"]);
    refuses(&train(&["--segment", "true {in} {out}"]), &["--drop-support", "masks from all views"]);
    assert!(!run.exists(), "nothing half-written");
}
