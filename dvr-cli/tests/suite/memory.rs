//! What a run is said to take of memory, against what it takes; and refusals of what there is no memory for.

use crate::support::{SMALL, Tiny, dvr, refuses, succeeds, text};
use dvr_core::mesh::shapes;

/// By how much the estimate may lie above the peak.
const FACTOR: f64 = 3.0;

/// Megabytes that `dvr train` says it takes, and those that it took at its peak.
fn said_and_measured(tiny: &Tiny, run: &str, more: &[&str]) -> [f64; 2] {
    let (scene, out) = (tiny.scene(), tiny.path(run));
    let output = dvr(&[&["train", text(&scene), "--out", text(&out), "--no-report"][..], more].concat());
    succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let said = said.split("memory: about ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let metrics = std::fs::read_to_string(out.join("metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_str(&metrics).unwrap();
    [said, metrics["resources"]["peak_memory"].as_f64().unwrap() / 1e6]
}

#[test]
#[cfg(target_os = "linux")]
fn the_estimate_lies_above_the_peak_and_not_far() {
    let (small, middle) = (Tiny::new(), Tiny::rendered(shapes::torus(1.0, 0.45, 64, 32), 24, 160));
    let network = [&SMALL[..], &["--steps", "24", "--resolution", "64"]].concat();
    let runs = [
        ("small grid", &small, &["--steps", "20", "--capacity", "32", "--resolution", "32"][..]),
        ("middle grid", &middle, &["--steps", "20", "--capacity", "128", "--resolution", "128"]),
        ("large grid", &middle, &["--steps", "4", "--capacity", "256", "--resolution", "128"]),
        ("large texture", &small, &["--steps", "4", "--capacity", "32", "--resolution", "32", "--texture", "2048"]),
        ("small network", &small, &network),
    ];
    for (i, (name, tiny, more)) in runs.into_iter().enumerate() {
        let [said, measured] = said_and_measured(tiny, &format!("run{i}"), more);
        println!("{name}: {said:.0} MB estimated, {measured:.0} MB at the peak");
        assert!(
            said >= measured && said <= FACTOR * measured,
            "{name}: {said} MB estimated, {measured} MB at the peak"
        );
    }
}

#[test]
fn what_there_is_no_memory_for_is_refused_with_what_is_needed_and_a_remedy() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let train = ["train", text(&scene), "--out", text(&run), "--steps", "10", "--capacity", "32", "--resolution", "32"];
    let parts = ["MB of memory are needed", "--capacity", "--resolution", "--memory"];
    let large = ["train", text(&scene), "--out", text(&run), "--capacity", "512", "--memory", "1G"];
    refuses(&dvr(&large), &parts);
    assert!(!run.exists(), "nothing half-written");
    succeeds(&dvr(&train));
    let mesh = tiny.path("mesh.ply");
    refuses(&dvr(&["mesh", text(&run), "--out", text(&mesh), "--resolution", "2048", "--memory", "2G"]), &parts);
    refuses(&dvr(&["eval", text(&run), "--resolution", "2048", "--memory", "2G"]), &parts);
    let out = tiny.path("frames");
    let render = ["render", text(&run), "--out", text(&out), "--size", "8192", "--memory", "1G"];
    refuses(&dvr(&render), &["MB of memory are needed", "--size"]);
    assert!(!mesh.exists() && !out.exists());
}

#[test]
fn masks_that_there_is_no_memory_to_find_are_refused_and_nothing_is_made() {
    let tiny = Tiny::new();
    let (scene, run, masks) = (tiny.scene(), tiny.path("run"), tiny.path("masks"));
    std::fs::remove_dir_all(scene.join("mask")).unwrap();
    let parts = ["MB of memory are needed", "--memory"];
    let (scene, little) = (text(&scene).to_owned(), ["--memory", "150M"]);
    refuses(&dvr(&[&["masks", &scene, "--out", text(&masks)][..], &little].concat()), &parts);
    refuses(&dvr(&[&["train", &scene, "--out", text(&run)][..], &little].concat()), &parts);
    assert!(!run.exists() && !masks.exists(), "nothing half-written");
}

#[test]
fn a_texture_that_there_is_no_memory_for_is_refused_before_anything_is_made() {
    let tiny = Tiny::new();
    let (scene, run, large) = (tiny.scene(), tiny.path("run"), ["--texture", "8192", "--memory", "1G"]);
    let train = ["train", text(&scene), "--out", text(&run), "--steps", "4", "--capacity", "32", "--resolution", "32"];
    let parts = ["8192 texels", "MB of memory to make", "MB are left", "--texture N", "--texture off", "--memory"];
    refuses(&dvr(&[&train[..], &large].concat()), &parts);
    assert!(!run.exists(), "nothing half-written");
    succeeds(&dvr(&train));
    let mesh = tiny.path("mesh.glb");
    let again = ["mesh", text(&run), "--out", text(&mesh), "--resolution", "32"];
    refuses(&dvr(&[&again[..], &large].concat()), &parts);
    assert!(!mesh.exists());
    // Without a texture, there is enough.
    succeeds(&dvr(&[&again[..], &["--texture", "off", "--memory", "1G"]].concat()));
}
