//! Surfaces by the protocol of DTU.

use std::path::{Path, PathBuf};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::Scene;
use dvr_core::mesh::{Mesh, shapes, write_mesh};
use dvr_core::sampling::sample_surface;
use dvr_test_support::{MatEntry, mat_file};
use glam::Vec3;

/// Evaluation data whose scan is `points`: everything within 50 mm was seen, and the table lies 30 mm below.
fn write_reference(folder: &Path, scan: u32, points: Vec<Vec3>) {
    for inner in ["ObsMask", "Points/stl"] {
        std::fs::create_dir_all(folder.join(inner)).unwrap();
    }
    let doubles = |numbers: &[f64]| numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let (cell, corners) = (doubles(&[10.0]), doubles(&[-50.0, 50.0, -50.0, 50.0, -50.0, 50.0]));
    let mask = mat_file(&[
        MatEntry::bytes("ObsMask", &[11, 11, 11], &[1; 1331]),
        MatEntry::doubles("BB", &[2, 3], &corners),
        MatEntry::doubles("Res", &[1, 1], &cell),
    ]);
    std::fs::write(folder.join(format!("ObsMask/ObsMask{scan}_10.mat")), mask).unwrap();
    let plane = mat_file(&[MatEntry::doubles("P", &[4, 1], &doubles(&[0.0, 0.0, 1.0, 30.0]))]);
    std::fs::write(folder.join(format!("ObsMask/Plane{scan}.mat")), plane).unwrap();
    let cloud = Mesh { vertices: points, ..Mesh::default() };
    write_mesh(folder.join(format!("Points/stl/stl{scan:03}_total.ply")), &cloud).unwrap();
}

/// A ball of 20 mm and the evaluation data of one of 20.5.
fn ball_and_reference(folder: &Path) -> [PathBuf; 2] {
    let [mesh, reference] = ["ball.ply", "reference"].map(|name| folder.join(name));
    write_mesh(&mesh, &shapes::icosphere(5, 20.0)).unwrap();
    write_reference(&reference, 24, sample_surface(&shapes::icosphere(6, 20.5), 60_000, 1).points);
    [mesh, reference]
}

#[test]
fn a_mesh_and_evaluation_data_are_enough_and_the_only_scan_needs_no_number() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, reference] = ball_and_reference(folder.path()).map(|path| text(&path).to_owned());
    let json = folder.path().join("figures.json");
    let args = ["eval", &mesh, "--protocol", "dtu", "--reference", &reference, "--json", text(&json)];
    let table = succeeds(&dvr(&args));
    assert!(table.contains("DTU protocol, scan 24 (mm)") && table.contains("not culled by masks"), "{table}");
    let figures: serde_json::Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    let figures = &figures["dtu"];
    for direction in ["accuracy", "completeness"] {
        let mean = figures[direction]["mean"].as_f64().unwrap();
        assert!((0.5..0.54).contains(&mean), "half a millimetre, and how far samples are apart: {mean}");
    }
    assert_eq!((figures["scan"].as_u64(), figures["alignment"].is_null()), (Some(24), true));

    write_reference(Path::new(&reference), 65, vec![Vec3::ZERO]);
    let args = &args[..6];
    refuses(&dvr(args), &["2 scans (24, 65)", "--scan"]);
    let again = succeeds(&dvr(&[args, &["--scan", "24"]].concat()));
    assert!(table.starts_with(&again), "{again}");
    let named = folder.path().join("scan024.ply");
    std::fs::copy(&mesh, &named).unwrap();
    assert_eq!(succeeds(&dvr(&["eval", text(&named), "--protocol", "dtu", "--reference", &reference])), again);
}

#[test]
fn a_scene_tells_what_is_culled() {
    let tiny = Tiny::new();
    let scene = Scene::read(tiny.scene()).unwrap();
    // Points of the surface, which all masks show, and some beside it, which none shows.
    let to_world = |point: Vec3| scene.object_to_world.transform_point_f32(point);
    let surface: Vec<Vec3> =
        scene.ground_truth.surface.as_ref().unwrap().points.iter().map(|&point| to_world(point)).collect();
    let beside = (0..40).map(|i| to_world(Vec3::new(0.9, -0.5 + 0.025 * i as f32, 0.0)));
    let (mesh, reference) = (tiny.path("both.ply"), tiny.path("reference"));
    let both = Mesh { vertices: surface.iter().copied().chain(beside).collect(), ..Mesh::default() };
    write_mesh(&mesh, &both).unwrap();
    write_reference(&reference, 1, surface);
    let points_of = |more: &[&str]| {
        let json = tiny.path("figures.json");
        let args = ["eval", text(&mesh), "--no-views", "--protocol", "dtu", "--reference", text(&reference)];
        let said = succeeds(&dvr(&[&args[..], &["--overwrite", "--json", text(&json)], more].concat()));
        let figures: serde_json::Value = serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap();
        (figures["dtu"]["accuracy"]["points"].as_u64().unwrap(), said)
    };
    let data = tiny.scene();
    let (all, _) = points_of(&[]);
    let (left, said) = points_of(&["--data", text(&data), "--cull", "1.5"]);
    assert!(said.contains("dilated by 1.5 pixels"), "{said}");
    assert!(left < all && left > 0, "{left} of {all}");
    let args = ["eval", text(&mesh), "--protocol", "dtu", "--reference", text(&reference), "--cull", "2"];
    refuses(&dvr(&args), &["--cull", "--data"]);
}

#[test]
fn missing_and_damaged_evaluation_data_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [mesh, reference] = ball_and_reference(folder.path()).map(|path| text(&path).to_owned());
    let args = ["eval", &mesh, "--protocol", "dtu", "--reference", &reference];
    refuses(&dvr(&args[..4]), &["--reference"]);
    refuses(&dvr(&["eval", &mesh, "--reference", &reference]), &["--protocol"]);
    refuses(&dvr(&[&args[..], &["--scan", "7"]].concat()), &["ObsMask/ObsMask7_10.mat", "SampleSet"]);
    refuses(&dvr(&["eval", &mesh, "--protocol", "dtu", "--reference", "/nowhere"]), &["/nowhere", "ObsMask24_10.mat"]);
    refuses(&dvr(&["eval", &mesh, "--protocol", "middlebury", "--reference", &reference]), &["dtu"]);
    let far = folder.path().join("far.ply");
    let moved = shapes::icosphere(3, 20.0).vertices.iter().map(|&vertex| vertex + 1000.0).collect();
    write_mesh(&far, &Mesh { vertices: moved, ..shapes::icosphere(3, 20.0) }).unwrap();
    refuses(&dvr(&[&["eval", text(&far)], &args[2..]].concat()), &["observation mask", "millimetres"]);
    std::fs::write(Path::new(&reference).join("ObsMask/Plane24.mat"), "no plane").unwrap();
    refuses(&dvr(&args), &["Plane24.mat", "MAT file"]);
}
