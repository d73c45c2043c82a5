//! `dvr bench`: methods side by side.

mod support;

use std::process::Output;

use support::{Tiny, dvr, refuses, succeeds, text};

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
