//! Meshes against verified points: given as files, and brought by scenes.

use std::path::PathBuf;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::Scene;
use dvr_core::mesh::{shapes, write_mesh};
use dvr_core::npz::{Array, Values, write_npz};
use glam::{DVec3, Vec3};
use tempfile::TempDir;

/// A box of 200 units with a mesh of its own, and a hundred points half a unit above its top.
fn box_and_points(folder: &TempDir) -> [PathBuf; 2] {
    let [mesh, points] = ["box.ply", "points.npz"].map(|name| folder.path().join(name));
    write_mesh(&mesh, &shapes::cuboid(Vec3::splat(-100.0), Vec3::splat(100.0))).unwrap();
    let above = (0..100).flat_map(|i| [f64::from(i % 10) * 9.0, f64::from(i / 10) * 9.0, 100.5]);
    write_npz(&points, &[("points", &Array::f64(&[100, 3], above.collect()))]).unwrap();
    [mesh, points]
}

#[test]
fn a_mesh_and_points_are_enough() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, points] = box_and_points(&folder).map(|path| text(&path).to_owned());
    let json = folder.path().join("figures.json");
    let more = ["--thresholds", "0.4,0.6", "--json", text(&json)];
    let table = succeeds(&dvr(&[&["eval", &mesh, "--points", &points], &more[..]].concat()));
    assert!(table.contains("100 verified points") && table.contains("0.5000"), "{table}");
    let figures: serde_json::Value = serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap();
    let figures = &figures["points"];
    assert_eq!((figures["points"].as_u64(), figures["hidden"].is_null()), (Some(100), true));
    assert!((figures["distances"]["mean"].as_f64().unwrap() - 0.5).abs() < 1e-6);
    let below: Vec<f64> =
        [0, 1].map(|i| figures["distances"]["below"][i]["share"].as_f64().unwrap()).into_iter().collect();
    assert_eq!(below, [0.0, 1.0]);
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, points] = box_and_points(&folder).map(|path| text(&path).to_owned());
    refuses(&dvr(&["eval", &mesh]), &["--data", "--points"]);
    refuses(&dvr(&["eval", &mesh, "--points", &mesh.replace("box", "nowhere")]), &["nowhere.ply"]);
    refuses(&dvr(&["eval", &mesh, "--points", &points, "--margin", "0"]), &["\"0\" is not a length"]);
    std::fs::write(&points, "no archive").unwrap();
    refuses(&dvr(&["eval", &mesh, "--points", &points]), &["points.npz", "not a whole .npz archive"]);
}

/// Gives a scene sparse points of its true surface, each seen by the views that it faces, as `pcl.npz`.
fn add_sparse_points(tiny: &Tiny) {
    let scene = Scene::read(tiny.scene()).unwrap();
    let surface = scene.ground_truth.surface.as_ref().unwrap();
    let normals = surface.normals.as_ref().unwrap();
    let world: Vec<DVec3> =
        surface.points.iter().map(|point| scene.object_to_world.transform_point(point.as_dvec3())).collect();
    let flat = world.iter().flat_map(|point| point.to_array()).collect();
    let mut arrays = vec![("points".to_owned(), Array::f64(&[world.len(), 3], flat))];
    for (index, view) in scene.views.iter().enumerate() {
        let faces = |(point, normal): (&Vec3, &Vec3)| {
            let to_camera = (view.camera.center() - point.as_dvec3()).normalize();
            to_camera.dot(normal.as_dvec3()) > 0.6
        };
        let seen: Vec<bool> = surface.points.iter().zip(normals).map(faces).collect();
        let seen = Array { shape: vec![seen.len()], values: Values::Bool(seen) };
        arrays.push((format!("visibility_{index:04}"), seen));
    }
    let arrays: Vec<_> = arrays.iter().map(|(name, array)| (name.as_str(), array)).collect();
    write_npz(&tiny.scene().join("pcl.npz"), &arrays).unwrap();
}

#[test]
fn scenes_that_bring_points_are_measured_by_them_and_say_when_they_were_trained_on() {
    let tiny = Tiny::new();
    add_sparse_points(&tiny);
    let points_of = |run: &str| {
        let metrics = std::fs::read(tiny.path(run).join("metrics.json")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&metrics).unwrap()["points"].clone()
    };
    let said = succeeds(&tiny.train("run", &[]));
    assert!(said.contains("verified points: sparse points of the scene (DVR)"), "{said}");
    assert!(!said.contains("not independent"), "{said}");
    let figures = points_of("run");
    assert!(figures["not_independent"].is_null() && figures["hidden"]["witnesses"] == "tracks", "{figures}");
    let report = std::fs::read_to_string(tiny.path("run").join("report.html")).unwrap();
    assert!(report.contains("Verified points") && report.contains("Hidden points"));

    let said = succeeds(&tiny.train("taught", &["--set", "losses.sparse_depth=1"]));
    assert!(said.contains("not independent: the mesh was trained on them"), "{said}");
    assert!(points_of("taught")["not_independent"].is_string());
    let table = succeeds(&dvr(&["eval", text(&tiny.path("taught")), "--resolution", "32", "--no-views"]));
    assert!(table.contains("not independent") && table.contains("where 2 views see it"), "{table}");
    let mesh = tiny.path("run/mesh.ply");
    let table = succeeds(&dvr(&["eval", text(&mesh), "--data", text(&tiny.scene()), "--no-views"]));
    assert!(table.contains("lines of sight of tracks, blocked") && !table.contains("not independent"), "{table}");
}
