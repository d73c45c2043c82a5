//! Surfaces of clouds of points on the command line.

use std::path::PathBuf;
use std::process::Command;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::{Mesh, read_mesh, shapes, write_mesh};
use dvr_core::sampling::sample_surface;
use dvr_test_support::test_with;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

/// Points of a ball, with normals where they are asked for.
fn ball(folder: &TempDir, has_normals: bool) -> PathBuf {
    let samples = sample_surface(&shapes::icosphere(4, 1.0), 8000, 1);
    let normals = has_normals.then_some(samples.normals);
    let path = folder.path().join(if has_normals { "ball.ply" } else { "bare.ply" });
    write_mesh(&path, &Mesh { vertices: samples.points, normals, ..Mesh::default() }).unwrap();
    path
}

#[test_with(colmap)]
fn points_become_a_surface_in_every_format_and_files_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = ball(&folder, true);
    for name in ["ball.glb", "surface.ply", "ball.obj"] {
        let out = folder.path().join(name);
        let args = ["points2mesh", text(&cloud), "--out", text(&out), "--depth", "5", "--colmap-threads", "1"];
        let said = succeeds(&dvr(&args));
        assert!(said.contains("8000 points became"), "{said}");
        let surface = read_mesh(&out).unwrap().mesh;
        assert!(surface.faces.len() > 500 && surface.normals.is_some());
        assert!(surface.vertices.iter().all(|vertex| (vertex.length() - 1.0).abs() < 0.05));
        refuses(&dvr(&args), &[name, "--overwrite"]);
    }
    let out = folder.path().join("small.ply");
    let args = ["points2mesh", text(&cloud), "--out", text(&out), "--depth", "5", "--faces", "200"];
    assert!(succeeds(&dvr(&args)).contains("simplified"));
    assert!(read_mesh(&out).unwrap().mesh.faces.len() <= 200);
}

#[test]
fn what_cannot_become_a_surface_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [bare, cloud] = [false, true].map(|has_normals| ball(&folder, has_normals));
    let out = folder.path().join("out.ply");
    refuses(&dvr(&["points2mesh", text(&bare), "--out", text(&out)]), &["bare.ply", "no", "normal", "MeshLab"]);
    refuses(&dvr(&["points2mesh", "/nowhere.ply", "--out", text(&out)]), &["/nowhere.ply"]);
    refuses(&dvr(&["points2mesh", text(&cloud), "--out", "/tmp/a.stl"]), &["/tmp/a.stl", ".glb"]);
    refuses(&dvr(&["points2mesh", text(&cloud), "--out", text(&out), "--trim", "21"]), &["--trim", "0 to 20"]);
    let alone = Command::new(env!("CARGO_BIN_EXE_dvr"))
        .args(["points2mesh", text(&cloud), "--out", text(&out)])
        .env("PATH", folder.path())
        .output()
        .unwrap();
    refuses(&alone, &["`colmap`, which makes surfaces of points", "apt install colmap"]);
    assert!(!out.exists());
}

/// A ball whose vertices have colours at random, from forty sides.
fn speckled() -> Tiny {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let ball = shapes::icosphere(5, 1.0);
    let colors = ball.vertices.iter().map(|_| [0; 3].map(|_: i32| rng.random_range(0.0..1.0))).collect();
    Tiny::rendered(Mesh { colors: Some(colors), ..ball }, 40, 96)
}

#[test_with(colmap)]
fn a_scene_becomes_a_surface_by_its_stereo_depth_maps() {
    let tiny = speckled();
    let (scene, out, cloud) = (tiny.scene(), tiny.path("surface.ply"), tiny.path("cloud.ply"));
    let args = ["points2mesh", text(&scene), "--out", text(&out), "--cloud-out", text(&cloud)];
    let said = succeeds(&dvr(&[&args[..], &["--depth", "6", "--colmap-threads", "1"]].concat()));
    assert!(said.contains("stereo found") && said.contains("points became"), "{said}");
    let points = read_mesh(&cloud).unwrap().mesh;
    assert!(points.vertices.len() > 5000 && points.normals.is_some() && points.colors.is_some());
    let iou = tiny.volume_iou(&out);
    assert!(iou > 0.8, "{iou}");
}

#[test]
fn scenes_without_depths_and_clouds_with_a_second_output_are_refused() {
    let tiny = Tiny::new();
    let (scene, out, second) = (tiny.scene(), tiny.path("surface.ply"), tiny.path("c.ply"));
    refuses(&dvr(&["points2mesh", text(&scene), "--out", text(&out), "--views", "3"]), &["no depths", "3 photographs"]);
    let cloud = ball(&tiny.folder, true);
    let args = ["points2mesh", text(&cloud), "--out", text(&out), "--cloud-out", text(&second)];
    refuses(&dvr(&args), &["--cloud-out", "ball.ply"]);
    refuses(&dvr(&["points2mesh", text(&cloud), "--out", text(&out), "--views", "3"]), &["photographs", "ball.ply"]);
    refuses(&dvr(&["points2mesh", text(&scene), "--out", text(&out), "--cloud-out", "/tmp/c.obj"]), &["c.obj", ".ply"]);
    assert!(!out.exists());
}
