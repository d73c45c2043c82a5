//! `dvr bench`: methods side by side.

use std::process::Output;

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::dataset::{ReadOptions, read_scene};
use dvr_core::npz::{Array, write_npz};

#[test]
fn a_run_that_fails_is_a_row_and_a_failure() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("bench"));
    std::fs::write(scene.join("image/0002.png"), "broken").unwrap();
    let bench = || dvr(&["bench", text(&scene), "--out", text(&out), "--methods", "hull"]);
    let output = bench();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("failed: torus.hull.rgb.0: error: ") && said.contains("0002.png"), "{said}");
    let table = std::fs::read_to_string(out.join("table.md")).unwrap();
    assert!(table.contains("| hull | 0 of 1 |"), "{table}");
    // Nothing of it is kept: a failure may have been the machine's.
    assert!(!out.join("runs/torus.hull.rgb.0.json").exists());
    std::fs::copy(scene.join("image/0003.png"), scene.join("image/0002.png")).unwrap();
    succeeds(&bench());
}

#[test]
fn methods_and_variants_share_a_table_and_are_not_run_twice() {
    let tiny = Tiny::new();
    let out = tiny.path("bench");
    let overlay = tiny.path("theirs.json");
    std::fs::write(&overlay, r#"[{"scene": "ball", "method": "theirs", "seconds": 600, "chamfer_l1": 0.0215}]"#)
        .unwrap();
    let scene = tiny.scene();
    let bench = || {
        dvr(&[
            "bench",
            text(&scene),
            "--out",
            text(&out),
            "--seeds",
            "2",
            "--variant",
            "short:steps=20,capacity={\"cells\":32}",
            "--methods",
            "hull",
            "--overlay",
            text(&overlay),
        ])
    };
    succeeds(&bench());
    let table = std::fs::read_to_string(out.join("table.md")).unwrap();
    for line in ["| hull | 1 of 1 |", "| short | 2 of 2 |", "| theirs | 1 of 1 | 600.0 |", "1 row(s) of unknown origin"]
    {
        assert!(table.contains(line), "{line} in\n{table}");
    }
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("PSNR against wall time") && page.contains("theirs"), "the charts are there");
    assert!(out.join("charts/torus-chamfer-l1-against-wall-time.svg").is_file());
    let read = || -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(out.join("results.json")).unwrap()).unwrap()
    };
    let first = read();
    assert_eq!(first["outcomes"].as_array().unwrap().len(), 4);
    assert!(first["outcomes"][1]["chamfer_l1"].as_f64().unwrap() < 0.05);
    let said = |output: &Output| String::from_utf8_lossy(&output.stderr).into_owned();
    let again = bench();
    succeeds(&again);
    assert!(said(&again).contains("runs: 3 of 3 are kept"), "{}", said(&again));
    assert_eq!(read(), first, "the same figures, seconds included");

    // A row is made again where its key differs, and says what it is itself.
    let kept = out.join("runs/torus.short.rgb.1.json");
    let older = std::fs::read_to_string(&kept).unwrap().replace("\"program\": \"dvr", "\"program\": \"older dvr");
    std::fs::write(&kept, older).unwrap();
    let again = bench();
    let table = succeeds(&again);
    let reason = "made again: torus.short.rgb.1 (of another program)";
    assert!(said(&again).contains(reason), "{}", said(&again));
    assert!(!table.contains("older dvr"), "{table}");
    let mask = scene.join("mask/0003.png");
    std::fs::copy(scene.join("mask/0004.png"), &mask).unwrap();
    let again = bench();
    succeeds(&again);
    assert!(said(&again).contains("0 of 3 are kept; 3 are made again"), "{}", said(&again));
    assert_ne!(read()["outcomes"][0]["key"]["scene"], first["outcomes"][0]["key"]["scene"]);

    refuses(&dvr(&["bench", "nowhere", "--out", text(&out)]), &["nowhere"]);
    std::fs::write(&overlay, r#"[{"scene": "ball"}]"#).unwrap();
    refuses(&bench(), &["theirs.json", "method"]);
    refuses(
        &dvr(&["bench", text(&scene), "--out", text(&tiny.path("b2")), "--methods", "hull", "--variant", "x:no.key=1"]),
        &["x.rgb.0", "unknown key"],
    );
}

#[test]
fn meshes_are_measured_by_the_points_in_their_scenes_folder() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("bench"));
    let bench = |more: &[&str]| {
        let args = ["bench", text(&scene), "--out", text(&out), "--methods", "hull", "--seeds", "1"];
        dvr(&[&args[..], more].concat())
    };
    refuses(&bench(&["--points", "verified_points.npz"]), &["--points verified_points.npz", "none of the scenes"]);
    // Points of the true surface, as they are and further along x.
    let truth = read_scene(&scene, &ReadOptions::default()).unwrap();
    let surface = &truth.ground_truth.surface.as_ref().unwrap().points[..500];
    let world = surface.iter().map(|point| truth.object_to_world.transform_point(point.as_dvec3()));
    let flat = |x: f64| Array::f64(&[500, 3], world.clone().flat_map(|p| [p.x + x, p.y, p.z]).collect());
    let mean = |more: &[&str]| {
        let table = succeeds(&bench(more));
        assert_eq!(table.contains("| points: mean | points: median |"), more.contains(&"--points"), "{table}");
        let results = std::fs::read_to_string(out.join("results.json")).unwrap();
        let results: serde_json::Value = serde_json::from_str(&results).unwrap();
        let outcome = &results["outcomes"][0];
        assert!(outcome["points_median"].as_f64() <= outcome["points_mean"].as_f64().map(|mean| 2.0 * mean));
        outcome["points_mean"].as_f64()
    };
    let points = ["--points", "verified_points.npz"];
    let means = [0.0, 0.3].map(|x| {
        write_npz(&scene.join("verified_points.npz"), &[("points", &flat(x))]).unwrap();
        mean(&points).unwrap()
    });
    // The torus has a radius of 1.45.
    assert!(means[0] > 0.0 && means[0] < 0.05 && means[1] > 0.1 && means[1] < 0.3, "{means:?}");
    let of_half = mean(&[&points[..], &["--downscale", "2"]].concat()).unwrap();
    assert!(of_half != means[1], "the same points, another hull");
    assert_eq!(mean(&[]), None);
}
