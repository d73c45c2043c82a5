//! `--faces` and `--preset`: meshes of as many faces as their use allows.

use std::path::Path;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::{Mesh, TexturedMesh, read_mesh, shapes, write_mesh};

/// A scene and its run, with a mesh of some thousand faces.
fn trained(more: &[&str]) -> (Tiny, std::path::PathBuf) {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let arguments = ["train", text(&scene), "--out", text(&run), "--steps", "40", "--resolution", "48"];
    succeeds(&dvr(&[&arguments[..], more].concat()));
    (tiny, run)
}

fn has_texture(mesh: &TexturedMesh) -> bool {
    mesh.materials.iter().any(|material| material.texture.is_some())
}

fn metrics(run: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap()
}

#[test]
fn a_mesh_of_few_faces_is_made_of_a_run_with_its_texture() {
    let (tiny, run) = trained(&[]);
    assert!(metrics(&run).get("simplification").is_none());
    let full = read_mesh(run.join("mesh.ply")).unwrap().mesh;
    assert!(full.faces.len() > 2000, "{}", full.faces.len());
    let mesh = |name: &str, more: &[&str]| {
        let out = tiny.path(name);
        let arguments = ["mesh", text(&run), "--resolution", "48", "--out", text(&out)];
        let said = succeeds(&dvr(&[&arguments[..], more].concat()));
        (read_mesh(&out).unwrap(), said, std::fs::read(&out).unwrap())
    };
    let (simple, said, _) = mesh("x.glb", &["--faces", "500"]);
    assert!(simple.mesh.faces.len() <= 500 && simple.mesh.faces.len() > 450, "{}", simple.mesh.faces.len());
    assert!(has_texture(&simple));
    let line = said.lines().find(|line| line.starts_with("simplified: ")).unwrap();
    let parts =
        [&format!("{} to {} faces", full.faces.len(), simple.mesh.faces.len()), "watertight", "units of the scene"];
    assert!(parts.iter().all(|part| line.contains(*part)), "{line}");
    let ply = mesh("x.ply", &["--faces", "1k", "--preset", "web"]).0;
    assert!(ply.mesh.faces.len() <= 1000, "--faces counts before --preset");
    assert_eq!(ply.mesh.open_edges(), 0);
    assert!(ply.mesh.colors.is_some());

    let (_, said, whole) = mesh("whole.ply", &[]);
    assert!(!said.contains("simplified"), "{said}");
    for more in [&["--faces", "full"][..], &["--faces", "1M"], &["--preset", "full"], &["--preset", "web"]] {
        let (_, said, bytes) = mesh(&format!("{}.ply", more.concat()), more);
        assert!(bytes == whole && !said.contains("simplified"), "{more:?}: {said}");
    }
    assert!(mesh("a.ply", &["--faces", "700"]).2 == mesh("b.ply", &["--faces", "700"]).2, "the same bytes each time");
}

#[test]
fn a_mesh_is_remeshed_and_compressed_where_that_is_asked_for() {
    let (tiny, run) = trained(&["--remesh", "--compress", "--no-report"]);
    // What a run leaves is read again: by `render`, which shows its texture, and by `texture`.
    let glb = run.join("mesh.glb");
    assert!(is_compressed(&glb) && has_texture(&read_mesh(&glb).unwrap()));
    let frames = ["--frames", "1", "--size", "32", "--animation", "none"];
    let turn = tiny.path("turn");
    let said = dvr(&[&["render", text(&run), "--out", text(&turn)], &frames[..]].concat());
    succeeds(&said);
    assert!(!String::from_utf8_lossy(&said.stderr).contains("not the mesh"));
    let mesh = |name: &str, more: &[&str]| {
        let out = tiny.path(name);
        let arguments = ["mesh", text(&run), "--resolution", "48", "--out", text(&out)];
        (succeeds(&dvr(&[&arguments[..], more].concat())), out)
    };
    let (said, even) = mesh("even.ply", &["--faces", "800", "--remesh"]);
    assert!(said.lines().any(|line| line.starts_with("remeshed: ") && line.contains("watertight")), "{said}");
    let even = read_mesh(&even).unwrap().mesh;
    assert!((640..960).contains(&even.faces.len()), "{}", even.faces.len());
    assert!(spread_of_edges(&even) < 0.35, "{}", spread_of_edges(&even));
    let simple = read_mesh(mesh("simple.ply", &["--faces", "800"]).1).unwrap().mesh;
    assert!(spread_of_edges(&simple) > spread_of_edges(&even) + 0.1);

    let (_, small) = mesh("small.glb", &["--texture", "off", "--compress"]);
    let (_, large) = mesh("large.glb", &["--texture", "off"]);
    let bytes = |path: &Path| std::fs::metadata(path).unwrap().len();
    assert!(is_compressed(&small) && !is_compressed(&large) && 3 * bytes(&small) < bytes(&large));
    let out = tiny.path("again.glb");
    let scene = tiny.scene();
    let again = ["texture", text(&small), "--data", text(&scene), "--out", text(&out), "--remesh", "--faces", "500"];
    assert!(succeeds(&dvr(&again)).contains("remeshed: "));
    let both = tiny.path("both.glb");
    let both = ["mesh", text(&run), "--remesh", "--simplify", "0.001", "--out", text(&both)];
    refuses(&dvr(&both), &["--simplify"]);
}

fn is_compressed(glb: &Path) -> bool {
    parts(glb).0["extensionsRequired"].as_array().is_some_and(|names| names.contains(&"EXT_meshopt_compression".into()))
}

/// Standard deviation of the lengths of edges, as a share of their mean.
fn spread_of_edges(mesh: &Mesh) -> f32 {
    let edges = (0..mesh.faces.len()).flat_map(|face| {
        let [a, b, c] = mesh.triangle(face);
        [a.distance(b), b.distance(c), c.distance(a)]
    });
    let edges: Vec<f32> = edges.collect();
    let mean = edges.iter().sum::<f32>() / edges.len() as f32;
    (edges.iter().map(|edge| (edge - mean).powi(2)).sum::<f32>() / edges.len() as f32).sqrt() / mean
}

#[test]
fn a_run_with_a_budget_says_what_it_cost() {
    let (tiny, run) = trained(&["--faces", "300", "--normal-map", "on", "--no-report"]);
    let metrics = metrics(&run);
    let simplification = &metrics["simplification"];
    assert!(metrics["mesh"][1].as_u64().unwrap() <= 300, "{}", metrics["mesh"]);
    assert!(simplification["faces_before"].as_u64().unwrap() > 2000 && simplification["open_edges"] == 0);
    let [mean, max] = ["mean_distance", "max_distance"].map(|key| simplification[key].as_f64().unwrap());
    assert!(mean > 0.0 && mean < max && max < 0.3, "{mean}, {max}: a torus of 2.9 units");
    let glb = read_mesh(run.join("mesh.glb")).unwrap();
    assert!(has_texture(&glb) && glb.mesh.faces.len() <= 300);
    assert_eq!(normal_map(&run.join("mesh.glb")), (true, true, true));
    assert!(metrics["self_intersections"].is_u64(), "{metrics}");
    let map = &metrics["texture"]["normal_map"];
    assert!(map["size"].as_u64().unwrap() >= 64 && map["met"].as_f64().unwrap() > 0.8, "{map}");
    let lit = tiny.path("lit.glb");
    let arguments = ["mesh", text(&run), "--resolution", "48", "--faces", "300", "--look", "material"];
    let said = succeeds(&dvr(&[&arguments[..], &["--out", text(&lit)]].concat()));
    assert!(said.lines().any(|line| line.starts_with("mesh: ") && line.contains(" intersect")), "{said}");
    assert!(said.contains("normal map: ") && normal_map(&lit) == (true, true, false), "{said}");
    let ply = read_mesh(run.join("mesh.ply")).unwrap().mesh;
    assert_eq!((ply.faces.len(), ply.open_edges()), (glb.mesh.faces.len(), 0));
}

#[test]
fn any_mesh_is_simplified_before_it_gets_a_texture() {
    let ball = shapes::icosphere(4, 1.0);
    let tiny = Tiny::rendered(ball.clone(), 12, 32);
    let (bare, scene, out) = (tiny.path("bare.ply"), tiny.scene(), tiny.path("out.glb"));
    write_mesh(&bare, &Mesh { normals: None, ..ball }).unwrap();
    let arguments = ["texture", text(&bare), "--data", text(&scene), "--out", text(&out), "--overwrite"];
    let said = succeeds(&dvr(&[&arguments[..], &["--faces", "1k"]].concat()));
    assert!(said.contains("simplified: 5120 to 1000 faces, watertight"), "{said}");
    let simple = read_mesh(&out).unwrap();
    assert_eq!((simple.mesh.faces.len(), has_texture(&simple)), (1000, true));
    // A texture of its own has seams: simplified again, they are no borders.
    let again = tiny.path("again.glb");
    let arguments = ["texture", text(&out), "--data", text(&scene), "--out", text(&again), "--faces", "200"];
    let said = succeeds(&dvr(&arguments));
    assert!(said.contains("to 200 faces, watertight"), "{said}");
}

/// The JSON of a GLB, and its data.
fn parts(glb: &Path) -> (serde_json::Value, Vec<u8>) {
    let mut bytes = std::fs::read(glb).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let data = bytes.split_off(20 + length);
    (serde_json::from_slice(&bytes[20..]).unwrap(), data)
}

/// Whether a GLB has a normal map, and tangents with normals, and is unlit.
fn normal_map(glb: &Path) -> (bool, bool, bool) {
    let json = parts(glb).0;
    let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
    let material = &json["materials"][0];
    let has_map = material["normalTexture"]["index"] == 1 && json["images"][1]["name"] == "normal_map";
    (has_map, attributes["TANGENT"].is_u64() && attributes["NORMAL"].is_u64(), material.get("extensions").is_some())
}

#[test]
fn a_simplified_mesh_with_a_texture_has_the_normals_of_the_full_one_as_a_texture() {
    let ball = shapes::icosphere(4, 1.0);
    let tiny = Tiny::rendered(ball.clone(), 12, 32);
    let (bare, scene) = (tiny.path("bare.ply"), tiny.scene());
    write_mesh(&bare, &Mesh { normals: None, ..ball }).unwrap();
    let made = |name: &str, more: &[&str]| {
        let out = tiny.path(name);
        let arguments = ["texture", text(&bare), "--data", text(&scene), "--size", "512", "--out", text(&out)];
        (succeeds(&dvr(&[&arguments[..], more].concat())), out)
    };
    let (said, glb) = made("on.glb", &["--faces", "500", "--normal-map", "on"]);
    assert!(said.contains("normal map: 256x256 texels, the full mesh met along the normals at"), "{said}");
    assert_eq!(normal_map(&glb), (true, true, true), "the colours are still shown as they are");
    assert!(has_texture(&read_mesh(&glb).unwrap()));
    let lit = made("lit.glb", &["--faces", "500", "--look", "material"]).1;
    assert_eq!(normal_map(&lit), (true, true, false));
    let lit_without = ["--faces", "500", "--look", "material", "--normal-map", "off"];
    for more in [&lit_without[..], &["--faces", "500"], &[]] {
        let (said, glb) = made(&format!("{}.glb", more.len()), more);
        assert!(!said.contains("normal map") && !normal_map(&glb).0 && !normal_map(&glb).1, "{more:?}: {said}");
    }
    assert!(!made("m.obj", &["--faces", "500", "--normal-map", "on"]).0.contains("normal map"), "GLB alone has one");
    let again = made("a.glb", &["--faces", "500", "--normal-map", "on"]).1;
    assert!(parts(&again).1 == parts(&glb).1, "the same bytes each time");
    refuses(
        &dvr(&["texture", text(&bare), "--data", text(&scene), "--out", "x.glb", "--normal-map", "maybe"]),
        &["maybe", "on", "off"],
    );
}

#[test]
fn numbers_of_faces_that_make_no_mesh_are_refused_before_anything_is_written() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("out"));
    for wrong in ["0", "3", "banana", "101M", "1e4"] {
        refuses(&dvr(&["train", text(&scene), "--out", text(&out), "--faces", wrong]), &[wrong, "from 4 to 100M"]);
        refuses(&dvr(&["mesh", text(&scene), "--out", "x.glb", "--faces", wrong]), &[wrong, "full", "50k"]);
        refuses(&dvr(&["texture", "m.ply", "--data", "d", "--out", "x.glb", "--faces", wrong]), &["from 4 to 100M"]);
    }
    refuses(&dvr(&["train", text(&scene), "--out", text(&out), "--preset", "tv"]), &["web", "print", "full"]);
    assert!(!out.exists());
}
