//! Runs that are killed (SIGKILL) at random times and resumed end with the same bytes as runs that were not.
//!
//! CI kills five times per method. More: `DVR_KILLS=200 cargo test --workspace --test suite kills:: -- --nocapture`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::{Corpus, Tiny, dvr, succeeds, text};
use dvr_train::Checkpoint;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use safetensors::SafeTensors;

/// What makes runs short: checkpoints every third step, and a mesh of few cells.
const SHORT: [&str; 19] = [
    "--steps",
    "20",
    "--set",
    "model.hidden=16",
    "--set",
    "rays=32",
    "--set",
    "validate_every=4",
    "--set",
    "checkpoint_every=3",
    "--set",
    "hull.resolution=16",
    "--set",
    "hull.warm_start_points=256",
    "--set",
    "hull.warm_start_steps=100",
    "--resolution",
    "16",
    "--no-report",
];

/// Stages of 16 and 32 cells. The grid stores every 500 steps: within the second stage.
const GRID: [&str; 13] = [
    "--steps",
    "300",
    "--capacity",
    "32",
    "--set",
    "first_cells=16",
    "--set",
    "color_coarseness=1",
    "--set",
    "rays=8",
    "--resolution",
    "16",
    "--no-report",
];

/// Kills of each method.
fn kills() -> usize {
    std::env::var("DVR_KILLS").ok().and_then(|kills| kills.parse().ok()).unwrap_or(5)
}

/// Everything in a run's folder that must be the same, by name: without times.
///
/// Networks are compared tensor by tensor, as they are exported: their checkpoints also hold the names by which burn tells
/// parameters apart, which are drawn at random in each process, and the head of an export is in random order.
fn results(run: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut results = BTreeMap::new();
    let exported = run.with_extension("safetensors");
    for entry in std::fs::read_dir(run).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let path = run.join(&name);
        let bytes = match path.extension().and_then(|ending| ending.to_str()) {
            Some("ckpt" | "dvr") => {
                let Checkpoint { mut header, state } = Checkpoint::load(&path).unwrap();
                header.seconds = 0.0;
                results.insert(format!("{name}: header"), serde_json::to_vec(&header).unwrap());
                if header.method.method == "grid" {
                    results.insert(format!("{name}: training"), state.training);
                    state.model
                } else {
                    succeeds(&dvr(&["export", text(&path), "--out", text(&exported), "--overwrite"]));
                    let file = std::fs::read(&exported).unwrap();
                    let tensors = SafeTensors::deserialize(&file).unwrap();
                    let sorted: BTreeMap<&str, _> = tensors.iter().collect();
                    sorted.iter().flat_map(|(name, tensor)| [name.as_bytes(), tensor.data()].concat()).collect()
                }
            }
            Some("csv") => without_times(&path),
            Some("json") if name == "metrics.json" => {
                let mut figures: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
                let figures = figures.as_object_mut().unwrap();
                figures.retain(|key, _| !key.ends_with("seconds") && key != "resources");
                serde_json::to_vec(&figures).unwrap()
            }
            _ => std::fs::read(&path).unwrap(),
        };
        results.insert(name, bytes);
    }
    results
}

/// The curves without seconds.
fn without_times(path: &Path) -> Vec<u8> {
    let text = std::fs::read_to_string(path).unwrap();
    let names: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let row = |line: &str| {
        let cells = names.iter().zip(line.split(',')).filter(|(name, _)| !name.ends_with("seconds"));
        cells.map(|(_, cell)| cell).collect::<Vec<_>>().join(",")
    };
    text.lines().map(row).collect::<Vec<_>>().join("\n").into_bytes()
}

fn start(arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dvr"));
    command.args(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Whether a session ended by itself before the time was up; then it succeeded.
fn ends_within(child: &mut Child, time: Duration) -> bool {
    let start = Instant::now();
    while start.elapsed() < time {
        if let Some(status) = child.try_wait().unwrap() {
            let mut said = String::new();
            std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut said).unwrap();
            assert!(status.success(), "{status:?}\n{said}");
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// The files of a killed run are those of the run that nobody killed.
fn are_equal(name: &str, whole: &Path, run: &Path) {
    let (expected, found) = (results(whole), results(run));
    assert!(found.keys().eq(expected.keys()), "{name}, {}: {:?}", run.display(), found.keys());
    for (file, bytes) in &expected {
        let shown = |bytes: &[u8]| String::from_utf8_lossy(&bytes[..bytes.len().min(3000)]).into_owned();
        let both = || format!("{}\nexpected\n{}", shown(&found[file]), shown(bytes));
        assert!(found[file] == *bytes, "{name}, {}: {file} differs: {}", run.display(), both());
    }
}

/// Kills runs of one command, again and again until each is done, and compares it with the run that nobody killed. In
/// the end both go on for as many steps as `more` says, which shows that the state of the optimiser is the same too.
fn kill_runs_of(name: &str, folder: &Path, arguments: &[&str], more: Option<&str>) {
    let whole = folder.join("whole");
    let clock = Instant::now();
    let mut unbroken = start(&[arguments, &["--out", text(&whole)]].concat());
    assert!(ends_within(&mut unbroken, Duration::from_secs(3600)));
    let length = clock.elapsed();
    let seed = std::env::var("DVR_KILLS_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(0);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut killed, mut sessions, mut from_checkpoints) = (0, 0, 0);
    let mut runs: Vec<PathBuf> = Vec::new();
    while killed < kills() {
        let run = folder.join(format!("run{}", runs.len()));
        let first = [arguments, &["--out", text(&run)]].concat();
        let resumed = [&first[..], &["--resume"]].concat();
        loop {
            from_checkpoints += usize::from(run.join("last.ckpt").exists());
            let mut child = start(if run.join("dvr-folder.json").exists() { &resumed } else { &first });
            sessions += 1;
            if ends_within(&mut child, length.mul_f64(random.random_range(0.0..1.0))) {
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
            killed += 1;
        }
        are_equal(name, &whole, &run);
        runs.last().into_iter().for_each(|earlier| std::fs::remove_dir_all(earlier).unwrap());
        runs.push(run);
    }
    if let (Some(more), Some(run)) = (more, runs.last()) {
        for run in [&whole, run] {
            let go_on = ["train", "--resume", "--out", text(run), "--steps", more, "--resolution", "16", "--no-report"];
            succeeds(&dvr(&go_on));
        }
        are_equal(name, &whole, run);
    }
    println!(
        "{name}: {killed} kills in {} runs of {:.1} s and {sessions} sessions, {from_checkpoints} of them from a \
         checkpoint; the same bytes each time",
        runs.len(),
        length.as_secs_f64()
    );
}

#[test]
fn killed_runs_of_the_grid_end_with_the_same_bytes() {
    let tiny = Tiny::new();
    let scene = tiny.scene();
    kill_runs_of("grid", tiny.folder.path(), &[&["train", text(&scene)], &GRID[..]].concat(), None);
}

#[test]
fn killed_runs_of_a_network_end_with_the_same_bytes() {
    let tiny = Tiny::new();
    let scene = tiny.scene();
    let arguments = [&["train", text(&scene), "--method", "network", "--set", "model.octaves=2"], &SHORT[..]].concat();
    kill_runs_of("network", tiny.folder.path(), &arguments, Some("26"));
}

#[test]
fn killed_runs_of_the_papers_settings_end_with_the_same_bytes() {
    let tiny = Tiny::new();
    let scene = tiny.scene();
    let few = ["--set", "march=[{\"from_percent\":0,\"samples\":16}]", "--set", "learning_rate=0.005"];
    let arguments = [&["train", text(&scene), "--method", "classic"], &few[..], &SHORT[..]].concat();
    kill_runs_of("classic", tiny.folder.path(), &arguments, Some("26"));
}

#[test]
fn killed_runs_on_a_dataset_of_objects_end_with_the_same_bytes() {
    let corpus = Corpus::new();
    let mut arguments = corpus.arguments("unused", &["--no-report"]);
    let place = arguments.iter().position(|argument| argument == "--out").unwrap();
    arguments.drain(place..place + 2);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    std::fs::create_dir(corpus.path("runs")).unwrap();
    kill_runs_of("objects", &corpus.path("runs"), &arguments, None);
}
