//! `--segment`: masks by a program of the user's choice, in `dvr train` and `dvr masks`.

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Tiny, dvr, refuses, succeeds, text};
use dvr_core::files::read_mask;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// A scene whose masks were taken away, and the folder that they are in now.
fn without_masks() -> (Tiny, PathBuf) {
    let tiny = Tiny::new();
    let kept = tiny.path("kept");
    std::fs::rename(tiny.scene().join("mask"), &kept).unwrap();
    (tiny, kept)
}

/// A program that copies the mask which was kept of the picture of the same name.
fn program(tiny: &Tiny, more: &str) -> String {
    let script = tiny.path("a program.sh");
    let kept = tiny.path("kept");
    let lines = format!("echo \"looking at $1\" >&2\n{more}\ncp \"{}/$(basename \"$1\")\" \"$2\"\n", kept.display());
    std::fs::write(&script, lines).unwrap();
    format!("sh '{}' {{in}} {{out}}", script.display())
}

#[test]
fn a_program_gives_the_masks_of_a_run_which_keeps_them() {
    let (tiny, kept) = without_masks();
    let (scene, run, command) = (tiny.scene(), tiny.path("run"), program(&tiny, ""));
    let train = |more: &[&str]| {
        let args =
            ["train", text(&scene), "--out", text(&run), "--method", "hull", "--resolution", "32", "--no-report"];
        dvr(&[&args[..], more].concat())
    };
    let output = train(&["--segment", &command, "--masks", "auto"]);
    succeeds(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    for part in ["no view has a mask; `sh ", "masks by sh (12 steps)", "masks were made by `sh ", "run/masks"] {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
    for entry in std::fs::read_dir(&kept).unwrap().map(|entry| entry.unwrap()) {
        let (given, found) = (read_mask(&entry.path()).unwrap(), read_mask(&run.join("masks").join(entry.file_name())));
        assert!(given == found.unwrap(), "{:?}", entry.file_name());
    }
    let iou = tiny_iou(&tiny, &kept, &run);
    assert!(iou > 0.8, "{iou}");
    // The run goes on with its masks and without the program; another program would have been another run.
    std::fs::remove_file(tiny.path("a program.sh")).unwrap();
    let resume =
        |more: &[&str]| dvr(&[&["train", "--resume", "--out", text(&run), "--resolution", "16"], more].concat());
    succeeds(&resume(&["--segment", &command]));
    refuses(&resume(&["--segment", "sam {in} {out}"]), &["--segment was sh ", "is sam {in} {out}"]);
}

/// The volume of a run's mesh against the truth, with the masks put back.
fn tiny_iou(tiny: &Tiny, kept: &PathBuf, run: &std::path::Path) -> f64 {
    std::fs::rename(kept, tiny.scene().join("mask")).unwrap();
    let iou = tiny.volume_iou(&run.join("mesh.ply"));
    std::fs::rename(tiny.scene().join("mask"), kept).unwrap();
    iou
}

#[test]
fn masks_alone_are_written_by_the_names_of_views() {
    let (tiny, kept) = without_masks();
    let (scene, out, command) = (tiny.scene(), tiny.path("masks"), program(&tiny, ""));
    let said = succeeds(&dvr(&["masks", text(&scene), "--out", text(&out), "--segment", &command]));
    assert!(said.contains("masks were made by `sh ") && said.contains("% of a picture"), "{said}");
    let names = |folder: &PathBuf| {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<_> = entries.filter(|name| name.to_string_lossy().ends_with(".png")).collect();
        names.sort();
        names
    };
    assert_eq!(names(&out), names(&kept));
}

#[test]
fn a_program_that_fails_is_named_with_the_photograph_and_its_words_and_nothing_is_written() {
    let (tiny, _) = without_masks();
    let (scene, run, out) = (tiny.scene(), tiny.path("run"), tiny.path("masks"));
    let failing = program(&tiny, "case \"$1\" in *0003.png) echo no such model >&2; exit 7 ;; esac");
    let parts = ["photograph `0003`", "a program.sh", "exit status: 7", "no such model", "--segment", "--ignore 0003"];
    refuses(&dvr(&["train", text(&scene), "--out", text(&run), "--segment", &failing]), &parts);
    refuses(&dvr(&["masks", text(&scene), "--out", text(&out), "--segment", &failing]), &parts);
    let silent = ["masks", text(&scene), "--out", text(&out), "--segment", "true {in} {out}"];
    refuses(&dvr(&silent), &["photograph `0000`", "`true {in} {out}` ended with success, and wrote no file", "{out}"]);
    assert!(!run.exists() && !out.exists(), "nothing half-written");
}

#[test]
fn commands_without_places_and_masks_that_are_there_are_refused() {
    let tiny = Tiny::new();
    let (scene, run, out) = (tiny.scene(), tiny.path("run"), tiny.path("masks"));
    let train = |more: &[&str]| dvr(&[&["train", text(&scene), "--out", text(&run)], more].concat());
    refuses(&train(&["--segment", "rembg i {in}"]), &["--segment", "{out} is missing", "rembg i {in} {out}"]);
    refuses(&train(&["--segment", "rembg i {out}"]), &["--segment", "{in} is missing"]);
    refuses(&train(&["--segment", "rembg i '{in} {out}"]), &["--segment", "quote"]);
    let command = ["--segment", "true {in} {out}"];
    refuses(&train(&[&command[..], &["--masks", "given"]].concat()), &["--segment", "--masks given", "leave out"]);
    refuses(&train(&[&command[..], &["--masks", text(&out)]].concat()), &["--segment", "--masks", "leave out"]);
    refuses(&train(&[&command[..], &["--background", "white"]].concat()), &["--segment", "--background"]);
    refuses(&train(&command), &["12 of 12 views have masks", "--segment", "Leave it out"]);
    refuses(
        &dvr(&[&["masks", text(&scene), "--out", text(&out)][..], &command].concat()),
        &["12 of 12 views have masks"],
    );
    assert!(!run.exists() && !out.exists(), "nothing half-written");
}

#[test]
fn ctrl_c_ends_the_program_and_leaves_nothing() {
    let (tiny, _) = without_masks();
    let (scene, out, temporary) = (tiny.scene(), tiny.path("masks"), tiny.path("tmp"));
    std::fs::create_dir(&temporary).unwrap();
    let mark = tiny.path("mark");
    let slow = program(&tiny, &format!("touch '{}'; sleep 60", mark.display()));
    let mut child = Command::new(env!("CARGO_BIN_EXE_dvr"))
        .args(["masks", text(&scene), "--out", text(&out), "--segment", &slow])
        .env("TMPDIR", &temporary)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !mark.exists() {
        assert!(child.try_wait().unwrap().is_none(), "the program is running");
        std::thread::sleep(Duration::from_millis(20));
    }
    let asked = Instant::now();
    kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), Signal::SIGINT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(asked.elapsed() < Duration::from_secs(30), "{:?}", asked.elapsed());
    assert!(!out.exists() && std::fs::read_dir(&temporary).unwrap().next().is_none(), "nothing is left");
}
