//! Ctrl-C and SIGTERM at any moment of any command: heard soon, exit code 130, no temporary file left, and runs go on.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{SMALL, Tiny, dvr, succeeds, text};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// How long a stop may take on a machine that does other things too; what it took is printed.
const PATIENCE: Duration = Duration::from_secs(60);

/// A child that was asked to end.
struct Stopped {
    code: Option<i32>,
    took: Duration,
    said: String,
}

fn start(args: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dvr"));
    command.args(args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn send(child: &Child, signal: Signal) {
    kill(Pid::from_raw(i32::try_from(child.id()).unwrap()), signal).unwrap();
}

/// Runs a command, sends it signals after a time (it may be over by then), and waits for its end.
fn stopped_after(args: &[&str], time: Duration, signals: &[Signal]) -> Stopped {
    let mut child = start(args);
    let mut stderr = child.stderr.take().unwrap();
    let reader = std::thread::spawn(move || {
        let mut said = String::new();
        stderr.read_to_string(&mut said).unwrap();
        said
    });
    std::thread::sleep(time);
    let asked = Instant::now();
    signals.iter().for_each(|signal| send(&child, *signal));
    let code = child.wait().unwrap().code();
    Stopped { code, took: asked.elapsed(), said: reader.join().unwrap() }
}

/// Files and folders with temporary names below a folder.
fn temporary(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()) {
        let name = entry.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with('.') && (name.ends_with(".tmp") || name.ends_with(".partial")) {
            found.push(entry.clone());
        }
        if entry.is_dir() {
            found.extend(temporary(&entry));
        }
    }
    found
}

/// Stops a command at several moments of the time that it takes, each time with another signal; `clean` brings back
/// what was before. Returns how often it was under way.
fn stop_everywhere(tiny: &Tiny, args: &[&str], moments: usize, mut clean: impl FnMut()) -> usize {
    clean();
    let start = Instant::now();
    succeeds(&dvr(args));
    let whole = start.elapsed();
    let mut under_way = 0;
    for i in 0..moments {
        clean();
        // Spread over the whole time, and away from a regular grid.
        let share = (i as f64 + 0.3 + 0.4 * (7.1 * i as f64).sin().abs()) / moments as f64;
        let signal = if i % 2 == 0 { Signal::SIGINT } else { Signal::SIGTERM };
        let Stopped { code, took, said } = stopped_after(args, whole.mul_f64(share), &[signal]);
        let last = said.lines().rfind(|line| !line.starts_with("stop") && !line.is_empty()).unwrap_or_default();
        println!("{} at {:.2} of {whole:.1?}: {code:?} after {took:.2?}; {last}", args[0], share);
        // A program that has not come to its first line yet is ended by the system.
        let is_too_early = code.is_none() && said.is_empty();
        assert!(is_too_early || matches!(code, Some(130 | 0)), "{code:?}: {said}");
        assert!(took < PATIENCE, "{took:?}: {said}");
        assert_eq!(temporary(tiny.folder.path()), Vec::<PathBuf>::new(), "{said}");
        under_way += usize::from(code == Some(130));
    }
    under_way
}

fn remove(path: &Path) {
    if path.is_dir() {
        std::fs::remove_dir_all(path).unwrap();
    }
}

#[test]
fn training_stops_in_every_phase_and_goes_on() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let of_method = [
        &["--steps", "60", "--capacity", "64", "--resolution", "96"][..],
        &[&SMALL[..], &["--steps", "60", "--resolution", "96"]].concat(),
    ];
    for more in of_method {
        let args = [&["train", text(&scene), "--out", text(&run)][..], more].concat();
        let under_way = stop_everywhere(&tiny, &args, 5, || {
            // What the last stop left goes on to its end, where there was a step.
            if run.join("last.ckpt").is_file() {
                succeeds(&dvr(&["train", "--resume", "--out", text(&run), "--resolution", "32", "--no-report"]));
                assert!(run.join("mesh.ply").is_file());
            }
            remove(&run);
        });
        assert!(under_way > 1, "{under_way} of 5 stops came in time");
    }
}

#[test]
fn a_second_signal_ends_at_once_without_temporary_files() {
    let tiny = Tiny::new();
    let (scene, run) = (tiny.scene(), tiny.path("run"));
    let args = ["train", text(&scene), "--out", text(&run), "--steps", "100000", "--capacity", "32"];
    let Stopped { code, took, said } = stopped_after(&args, Duration::from_secs(4), &[Signal::SIGINT, Signal::SIGTERM]);
    assert_eq!(code, Some(130), "{said}");
    assert!(took < PATIENCE, "{took:?}");
    assert_eq!(temporary(tiny.folder.path()), Vec::<PathBuf>::new());
}

#[test]
fn commands_on_a_run_stop_everywhere() {
    let tiny = Tiny::new();
    let (scene, run, out) = (tiny.scene(), tiny.path("run"), tiny.path("out"));
    let train = ["train", text(&scene), "--out", text(&run), "--steps", "20", "--capacity", "32", "--resolution", "32"];
    succeeds(&dvr(&train));
    let (mesh, page) = (tiny.path("big.ply"), tiny.path("page.html"));
    let commands: [&[&str]; 4] = [
        &["mesh", text(&run), "--out", text(&mesh), "--resolution", "256"],
        &["render", text(&run), "--out", text(&out), "--frames", "40", "--size", "128"],
        &["eval", text(&run), "--resolution", "128"],
        &["report", text(&run), "--out", text(&page)],
    ];
    for args in commands {
        stop_everywhere(&tiny, args, 3, || {
            remove(&out);
            for file in [&mesh, &page] {
                let _ = std::fs::remove_file(file);
            }
        });
    }
}

#[test]
fn commands_that_run_others_stop_with_them() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.scene(), tiny.path("out"));
    let bench = ["bench", text(&scene), "--out", text(&out), "--methods", "hull", "--seeds", "1"];
    // A grid of few cells and steps beside it.
    let bench = [&bench[..], &["--variant", r#"small:steps=60,capacity={"cells":32}"#]].concat();
    let stress = ["stress", "--out", text(&out), "--axis", "genus", "--methods", "hull"];
    for args in [&bench[..], &stress] {
        let under_way = stop_everywhere(&tiny, args, 3, || remove(&out));
        assert!(under_way > 0);
    }
}

#[test]
fn datasets_stop_in_the_middle_of_an_object() {
    let tiny = Tiny::new();
    std::fs::create_dir(tiny.path("shapes")).unwrap();
    let (mesh, out) = (tiny.path("shapes/torus.ply"), tiny.path("out"));
    let torus = dvr_core::mesh::shapes::torus(1.0, 0.45, 96, 48);
    dvr_core::mesh::write_mesh(&mesh, &torus).unwrap();
    let args = ["synth", text(&mesh), "--out", text(&out), "--views", "60", "--size", "200"];
    let under_way = stop_everywhere(&tiny, &args, 3, || remove(&out));
    assert!(under_way > 0);
}
