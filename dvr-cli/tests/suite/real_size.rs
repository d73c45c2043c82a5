//! `--scale`: meshes in metres, by known lengths between two pixels of a photograph.

use std::path::Path;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::Bvh;
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::mesh::{Mesh, read_mesh, shapes};
use serde_json::Value;

/// A ball, which shows itself everywhere within its outline.
fn ball() -> Tiny {
    Tiny::rendered(shapes::icosphere(3, 1.0), 12, 48)
}

fn hull(tiny: &Tiny, out: &str, more: &[&str]) -> std::process::Output {
    let (scene, out) = (tiny.scene(), tiny.path(out));
    dvr(&[&["train", text(&scene), "--out", text(&out), "--method", "hull", "--resolution", "32"][..], more].concat())
}

fn mesh_of(path: &Path) -> Mesh {
    read_mesh(path).unwrap().mesh
}

fn real_size(run: &Path) -> Value {
    let metrics: Value = serde_json::from_str(&std::fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap();
    metrics["real_size"].clone()
}

/// The distance of what two pixels of a view show on a mesh in the coordinates of the files.
fn distance(tiny: &Tiny, mesh: &Mesh, view: &str, pixels: [[u32; 2]; 2]) -> f64 {
    let scene = read_scene(&tiny.scene(), &ReadOptions::default()).unwrap();
    let view = scene.views.iter().find(|found| found.name == view).unwrap();
    let (camera, tree) = (view.camera.into_world(&scene.object_to_world), Bvh::new(mesh));
    let [a, b] = pixels.map(|[u, v]| {
        let ray = camera.pixel_ray(u, v);
        ray.at(tree.closest_hit(&ray, 0.0, f64::INFINITY).unwrap().ray_depth)
    });
    a.distance(b)
}

#[test]
fn a_known_length_takes_the_mesh_to_metres_and_the_run_keeps_it() {
    let tiny = ball();
    succeeds(&hull(&tiny, "plain", &["--texture", "off"]));
    let said = succeeds(&hull(&tiny, "run", &["--texture", "off", "--scale", "0003.png:(16,24)-(31,20)=25cm"]));
    let run = tiny.path("run");
    assert!(said.contains("real size: ") && said.contains("by one known length"), "{said}");
    let (plain, scaled) = (mesh_of(&tiny.path("plain/mesh.ply")), mesh_of(&run.join("mesh.ply")));
    let units = distance(&tiny, &plain, "0003", [[16, 24], [31, 20]]);
    let factor = 0.25 / units;
    let size = real_size(&run);
    assert!((size["metres_per_unit"].as_f64().unwrap() / factor - 1.0).abs() < 1e-5, "{size} {factor}");
    assert_eq!(plain.faces, scaled.faces);
    for (in_units, in_metres) in plain.vertices.iter().zip(&scaled.vertices) {
        assert!(in_units.as_dvec3().distance(in_metres.as_dvec3() / factor) < 1e-5 * units, "about the origin");
    }
    let (low, high) = scaled.bounds().unwrap();
    for axis in 0..3 {
        let told = size["size_metres"][axis].as_f64().unwrap();
        assert!((told / f64::from((high - low)[axis]) - 1.0).abs() < 1e-5, "{size}");
    }
    let glb = mesh_of(&run.join("mesh.glb"));
    assert!(glb.bounds().unwrap().0.distance(low) < 1e-5 * (high - low).length(), "GLB too");
    let page = std::fs::read_to_string(run.join("report.html")).unwrap();
    assert!(page.contains("Real size"), "the report tells it");
    // Figures are those of the files' units.
    let eval = |run: &Path| succeeds(&dvr(&["eval", text(run), "--no-views", "--resolution", "32"]));
    assert_eq!(eval(&run).replace("run", ""), eval(&tiny.path("plain")).replace("plain", ""));
    // Again by itself, in the files' units, and by another length.
    let again = |name: &str, more: &[&str]| {
        let out = tiny.path(name);
        let args = ["mesh", text(&run), "--resolution", "32", "--texture", "off", "--out", text(&out)];
        (succeeds(&dvr(&[&args[..], more].concat())), mesh_of(&out))
    };
    let (said, same) = again("same.ply", &[]);
    assert!(said.contains("real size: ") && same.vertices == scaled.vertices, "{said}");
    let (said, off) = again("off.ply", &["--scale", "off"]);
    assert!(!said.contains("real size") && off.vertices == plain.vertices, "{said}");
    let feet = again("feet.ply", &["--scale", "0003:(16,24)-(31,20)=10ft"]).1;
    let ratio = (feet.bounds().unwrap().1 - feet.bounds().unwrap().0) / (high - low);
    assert!((ratio - 3.048 / 0.25).abs().max_element() < 1e-3, "{ratio}");
    assert_eq!(real_size(&run), size, "elsewhere changes nothing in the run");
    // In the run itself, it is kept.
    let own = ["mesh", text(&run), "--resolution", "32", "--texture", "off", "--scale", "0003:(16,24)-(31,20)=1m"];
    succeeds(&dvr(&own));
    let kept = real_size(&run)["metres_per_unit"].as_f64().unwrap();
    assert!((kept / (4.0 * factor) - 1.0).abs() < 1e-5, "{kept}");
    succeeds(&dvr(&["report", text(&run)]));
    // Also where the run goes on, and where a mesh without a unit is written in between.
    let in_cube = ["mesh", text(&run), "--resolution", "32", "--texture", "off", "--object-space"];
    succeeds(&dvr(&in_cube));
    succeeds(&dvr(&[
        "train",
        "--resume",
        "--out",
        text(&run),
        "--resolution",
        "32",
        "--texture",
        "off",
        "--no-report",
    ]));
    assert_eq!(real_size(&run)["metres_per_unit"].as_f64(), Some(kept));
    assert!((mesh_of(&run.join("mesh.ply")).bounds().unwrap().1 / high - 4.0).abs().max_element() < 1e-3);
    // Nobody takes metres for the units of the scene.
    let in_metres = run.join("mesh.ply");
    let parts = ["mesh.ply", "in metres", "--scale off"];
    refuses(&dvr(&["eval", text(&in_metres), "--data", text(&tiny.scene())]), &parts);
    let textured = tiny.path("t.glb");
    let scene = tiny.scene();
    let texture = ["texture", text(&in_metres), "--data", text(&scene), "--out", text(&textured)];
    refuses(&dvr(&texture), &parts);
    let resume = ["train", "--resume", "--out", text(&run), "--scale", "0003:(16,24)-(31,20)=2m"];
    refuses(&dvr(&resume), &["--scale was 0003:(16,24)-(31,20)=1m"]);
}

#[test]
fn lengths_that_disagree_are_told() {
    let tiny = ball();
    let more = ["--no-report", "--texture", "off", "--scale", "0003:(16,24)-(31,20)=25cm", "--scale"];
    let output = hull(&tiny, "run", &[&more[..], &["0003:(16,24)-(31,20)=50cm"]].concat());
    let said = succeeds(&output) + &String::from_utf8_lossy(&output.stderr);
    // Of a factor and twice the factor the mean of logarithms is the root of two of the one.
    for part in ["by 2 known lengths, which disagree by 41.4 % at most", "the known lengths disagree", "-29.3 %"] {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
}

#[test]
fn what_is_no_known_length_is_refused_before_training() {
    let tiny = ball();
    let refused = |length: &str, parts: &[&str]| refuses(&hull(&tiny, "run", &["--scale", length]), parts);
    refused("0003:(16,24)-(31,20)", &["--scale", "PICTURE:(x,y)-(x,y)=LENGTH"]);
    refused("0003:(16,24)-(31,20)=0m", &["0m", "0.000001"]);
    refused("0003:(16,24)-(31,20)=3", &["no unit"]);
    refused("0099:(16,24)-(31,20)=1m", &["--scale 0099:(16,24)-(31,20)=1m", "0099", "0003"]);
    refused("0003:(16,24)-(48,20)=1m", &["0003.png", "(48, 20)", "48x48"]);
    refused("0003:(16,24)-(1,1)=1m", &["0003:(16,24)-(1,1)=1m", "second pixel misses the mask", "--scale"]);
    assert!(!tiny.path("run").exists(), "nothing half-written");
    // Also where masks are made first.
    let (masks, kept) = (tiny.scene().join("mask"), tiny.path("kept"));
    std::fs::rename(&masks, &kept).unwrap();
    let command = format!("sh -c 'cp \"{}/$(basename \"$1\")\" \"$2\"' sh {{in}} {{out}}", kept.display());
    let beside = hull(&tiny, "run", &["--segment", &command, "--scale", "0003:(16,24)-(1,1)=1m"]);
    refuses(&beside, &["second pixel misses the mask", "--scale"]);
    assert!(!tiny.path("run").exists(), "nothing half-written");
    std::fs::rename(&kept, &masks).unwrap();
    succeeds(&hull(&tiny, "run", &["--no-report", "--texture", "off"]));
    let (run, before) = (tiny.path("run"), std::fs::read(tiny.path("run/mesh.ply")).unwrap());
    let mesh = |more: &[&str]| dvr(&[&["mesh", text(&run), "--resolution", "32"], more].concat());
    refuses(&mesh(&["--scale", "0003:(16,24)-(1,1)=1m"]), &["second pixel misses the mesh", "--scale"]);
    refuses(&mesh(&["--scale", "off", "--scale", "0003:(16,24)-(31,20)=1m"]), &["--scale off"]);
    refuses(&mesh(&["--scale", "0003:(16,24)-(31,20)=1m", "--object-space"]), &["--scale", "--object-space"]);
    assert!(std::fs::read(run.join("mesh.ply")).unwrap() == before, "nothing half-written");
}
