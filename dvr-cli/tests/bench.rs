//! `dvr bench`: methods side by side.

mod support;

use support::{Tiny, dvr, refuses, succeeds, text};

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
    for line in ["| hull | 1 |", "| short | 2 |", "| theirs | 1 | 600.0 |"] {
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
    succeeds(&bench());
    assert_eq!(read(), first, "the same figures, seconds included");

    refuses(&dvr(&["bench", "nowhere", "--out", text(&out)]), &["nowhere"]);
    std::fs::write(&overlay, r#"[{"scene": "ball"}]"#).unwrap();
    refuses(&bench(), &["theirs.json", "method"]);
    refuses(
        &dvr(&["bench", text(&scene), "--out", text(&tiny.path("b2")), "--methods", "hull", "--variant", "x:no.key=1"]),
        &["x.rgb.0", "unknown key"],
    );
}
