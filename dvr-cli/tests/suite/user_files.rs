//! A user's files are safe: what is not a run's is never touched, one process writes to a folder, and whatever ends a run,
//! half of a file is never seen and no temporary file stays.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::support::{SMALL, Tiny, dvr, refuses, succeeds, text};
use dvr_train::RunFolder;

/// The names in a folder with the bytes of its files.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap_or_default())).collect()
}

/// Nothing is in a run's folder but the manifest and what it lists.
fn holds_nothing_else(run: &Path) {
    let manifest = std::fs::read_to_string(run.join("dvr-folder.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let listed: Vec<&str> = manifest["files"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect();
    for name in contents(run).keys() {
        assert!(name == "dvr-folder.json" || listed.contains(&name.as_str()), "{name} is in the run's folder");
    }
}

/// The figures of a hull, which nothing has to be learned for.
fn hull(tiny: &Tiny, out: &str) {
    let (scene, out) = (tiny.scene(), tiny.path(out));
    succeeds(&dvr(&["train", text(&scene), "--out", text(&out), "--method", "hull", "--resolution", "16"]));
}

#[test]
fn a_folder_of_the_users_is_refused_by_every_command_and_stays_as_it_is() {
    let tiny = Tiny::new();
    hull(&tiny, "run");
    holds_nothing_else(&tiny.path("run"));
    let photos = tiny.path("photos");
    std::fs::create_dir(&photos).unwrap();
    for name in ["config.json", "mesh.ply", "preview.png", "0000.png", "orbit_0000.png", "results.json", "x.glb"] {
        std::fs::write(photos.join(name), "the user's").unwrap();
    }
    let before = contents(&photos);
    let (scene, run, out) = (tiny.scene(), tiny.path("run"), text(&photos));
    let (scene, run, mesh) = (text(&scene), text(&run), tiny.path("run/mesh.ply"));
    let folders: [&[&str]; 8] = [
        &["train", scene, "--method", "hull"],
        &["train", scene, "--method", "hull", "--overwrite"],
        &["render", run],
        &["render", run, "--cameras", "dataset", "--overwrite"],
        &["predict", run, scene, "--overwrite"],
        &["bench", scene, "--methods", "hull"],
        &["stress", "--axis", "gradient-scale"],
        &["synth", text(&mesh)],
    ];
    for command in folders {
        refuses(&dvr(&[command, &["--out", out]].concat()), &["photos", "not empty", "--out"]);
    }
    let (ply, config) = (photos.join("mesh.ply"), photos.join("config.json"));
    let files: [&[&str]; 4] = [
        &["mesh", run, "--resolution", "16", "--out", text(&ply)],
        &["export", run, "--out", text(&config)],
        &["report", run, "--out", text(&config)],
        &["eval", run, "--json", text(&config)],
    ];
    for command in files {
        refuses(&dvr(command), &["photos", "already", "--overwrite"]);
    }
    assert!(contents(&photos) == before, "nothing was touched");
    succeeds(&dvr(&[files[0], &["--overwrite"]].concat()));
    assert!(contents(&photos)["mesh.ply"] != before["mesh.ply"], "what was asked for is replaced");
}

#[test]
fn results_among_the_data_are_refused() {
    let tiny = Tiny::new();
    let scene = tiny.scene();
    let before = contents(&scene);
    for out in ["rings/torus", "rings/torus/run", "rings", "", "rings/../rings/torus/image/run"] {
        let out = tiny.path(out);
        let refused = dvr(&["train", text(&scene), "--out", text(&out), "--method", "hull"]);
        refuses(&refused, &["inside or around", "torus", "--out"]);
    }
    assert!(contents(&scene) == before);
}

#[test]
fn overwriting_removes_what_the_run_wrote_and_nothing_else() {
    let tiny = Tiny::new();
    hull(&tiny, "run");
    let run = tiny.path("run");
    for name in ["notes.txt", "mesh_cleaned.ply"] {
        std::fs::write(run.join(name), "the user's").unwrap();
    }
    std::fs::write(run.join(".mesh.ply.a1b2c3.dvr-tmp"), "of a killed process").unwrap();
    let scene = tiny.scene();
    let again = ["train", text(&scene), "--out", text(&run), "--method", "hull", "--resolution", "16"];
    refuses(&dvr(&again), &["already holds a run", "--resume", "--overwrite"]);
    succeeds(&dvr(&[&again[..], &["--overwrite", "--no-report"]].concat()));
    let now = contents(&run);
    assert!(!now.contains_key("report.html"), "the old report is gone");
    assert!(now["notes.txt"] == b"the user's" && now["mesh_cleaned.ply"] == b"the user's");
    assert!(!now.keys().any(|name| name.ends_with(".dvr-tmp") || name.ends_with(".lock")), "{:?}", now.keys());
}

#[test]
fn one_run_at_a_time_has_a_folder_and_a_killed_one_is_no_obstacle() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_dvr"))
        .args(["train", text(&scene), "--out", text(&run), "--steps", "1000000"])
        .args(SMALL)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !run.join("last.ckpt").exists() {
        assert!(child.try_wait().unwrap().is_none(), "the run goes on");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let resume = ["train", "--resume", "--out", text(&run), "--time", "0s", "--resolution", "16"];
    refuses(&dvr(&resume), &["run", "another process", "--out"]);
    refuses(&dvr(&["mesh", text(&run), "--resolution", "16"]), &["another process"]);
    let elsewhere = tiny.path("mesh.ply");
    succeeds(&dvr(&["mesh", text(&run), "--resolution", "16", "--out", text(&elsewhere)]));
    child.kill().unwrap();
    child.wait().unwrap();
    std::fs::write(run.join(".last.ckpt.a1b2c3.dvr-tmp"), "half").unwrap();
    assert!(run.join("dvr-folder.lock").exists(), "it was left");
    succeeds(&dvr(&resume));
    holds_nothing_else(&run);
}

#[test]
fn resuming_with_other_options_is_refused_with_the_difference() {
    let tiny = Tiny::new();
    hull(&tiny, "run");
    let (run, scene) = (tiny.path("run"), tiny.scene());
    let resume =
        |more: &[&str]| dvr(&[&["train", "--resume", "--out", text(&run), "--resolution", "16"], more].concat());
    let reading =
        ["--downscale", "2", "--ignore", "3,0004", "--normalise", "hull", "--background", "white", "--views", "7"];
    let differences = [
        "--downscale was 1, is 2",
        "--ignore was none, is 3,0004",
        "--normalise was auto, is hull",
        "--background was none, is ",
        "--views was none, is 7",
        "--no-mask-refinement was off, is on",
    ];
    refuses(&resume(&[&reading[..], &["--no-mask-refinement"]].concat()), &differences);
    refuses(&resume(&["--box", "(0,0,0) to (1,2,3)"]), &["--box was none, is "]);
    refuses(&resume(&["--method", "grid"]), &["--method was hull, is grid"]);
    refuses(
        &resume(&["--supervision", "depth", "--refine-cameras"]),
        &["--supervision was rgb", "--refine-cameras was 0"],
    );
    refuses(&resume(&["--seed", "4"]), &["setting seed was 0, is 4"]);
    refuses(&resume(&["--set", "rays=9", "--steps", "9"]), &["setting rays was", "steps was 0, is 9"]);
    refuses(&resume(&["--overwrite"]), &["--overwrite"]);
    let eval = |more: &[&str]| dvr(&[&["eval", text(&run), "--resolution", "16", "--no-views"], more].concat());
    refuses(&eval(&["--downscale", "2", "--ignore", "3"]), &["--downscale was 1, is 2", "--ignore was none, is 3"]);
    succeeds(&eval(&["--downscale", "1"]));
    // The same again is no difference, and what decides about nothing but time and place is free.
    let same =
        ["--downscale", "1", "--normalise", "auto", "--method", "hull", "--seed", "0", "--memory", "1G", "--no-report"];
    succeeds(&resume(&[&[text(&scene)], &same[..]].concat()));
}

#[test]
fn a_network_is_resumed_for_more_steps() {
    let tiny = Tiny::new();
    succeeds(&tiny.train("run", &[]));
    let refused = tiny.train("run", &["--resume", "--set", "rays=64", "--set", "model.hidden=16"]);
    refuses(&refused, &["setting rays was 128, is 64", "setting model.hidden was 32, is 16"]);
    let run = tiny.path("run");
    let more = ["train", "--resume", "--out", text(&run), "--steps", "26", "--resolution", "16"];
    assert!(succeeds(&dvr(&more)).contains("trained 26 steps"));
    let config = std::fs::read_to_string(run.join("config.json")).unwrap();
    assert!(config.contains("\"steps\": 26"), "{config}");
}

#[test]
fn a_run_that_has_no_checkpoint_yet_starts_from_its_beginning() {
    let tiny = Tiny::new();
    let (run, scene) = (tiny.path("run"), tiny.scene());
    drop(RunFolder::new(&run).create().unwrap());
    refuses(&dvr(&["train", "--resume", "--out", text(&run)]), &["before its first checkpoint", "again"]);
    let arguments = ["train", text(&scene), "--out", text(&run), "--method", "hull", "--resolution", "16"];
    let resumed = dvr(&[&arguments[..], &["--resume"]].concat());
    succeeds(&resumed);
    assert!(String::from_utf8_lossy(&resumed.stderr).contains("from its beginning"));
    std::fs::remove_file(run.join("last.ckpt")).unwrap();
    succeeds(&dvr(&arguments));
    refuses(&dvr(&arguments), &["already holds a run"]);
}

/// Runs a command with files limited to so many KiB; where more is written, the system refuses as on a full disk.
#[cfg(unix)]
fn with_small_files(kib: usize, args: &[&str]) -> std::process::Output {
    let script = format!("trap '' XFSZ; ulimit -f {kib}; exec \"$0\" \"$@\"");
    Command::new("bash").args(["-c", &script, env!("CARGO_BIN_EXE_dvr")]).args(args).output().unwrap()
}

#[cfg(unix)]
#[test]
fn where_the_disk_takes_no_more_the_file_is_named_and_the_run_can_go_on() {
    let tiny = Tiny::new();
    succeeds(&tiny.train("whole", &["--no-report"]));
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let mut train =
        vec!["train", text(&scene), "--out", text(&run), "--steps", "24", "--resolution", "32", "--no-report"];
    train.extend(SMALL);
    let resume = [&train[..], &["--resume"]].concat();
    let mut refused = Vec::new();
    for kib in [1, 2, 4, 16, 64, 256] {
        let is_new = !run.join("dvr-folder.json").exists();
        let output = with_small_files(kib, if is_new { &train } else { &resume });
        if output.status.success() {
            break;
        }
        refuses(&output, &["error: ", "run/"]);
        holds_nothing_else(&run);
        refused.push(kib);
    }
    assert!(refused.len() >= 3, "refused at {refused:?} KiB");
    succeeds(&dvr(&resume));
    holds_nothing_else(&run);
    for file in ["mesh.ply", "mesh.glb", "preview.png"] {
        assert!(contents(&run)[file] == contents(&tiny.path("whole"))[file], "{file}: bit for bit");
    }
}
