//! A process that reads inputs, and may die of one: what it did so far stands in a file of progress.

use std::collections::HashSet;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};

use super::{Reader, SECONDS_LIMIT, claims, input};

/// What a worker is to do.
pub struct Task {
    /// The reader.
    pub reader: &'static Reader,
    /// Seed of the inputs.
    pub seed: u64,
    /// Number of the first input.
    pub from: u64,
    /// How many inputs.
    pub inputs: u64,
    /// After how many seconds it stops all the same.
    pub seconds: f64,
    /// Files to read first, before any input is made.
    pub files: Vec<PathBuf>,
    /// Whether the files of extreme claims are read first too.
    pub claims: bool,
    /// Where what is found goes.
    pub findings: PathBuf,
    /// The file of progress.
    pub progress: PathBuf,
}

/// What a worker has done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// What is being read: a file, a claim or the number of an input.
    pub current: String,
    /// Number of the next input.
    pub next: u64,
    /// Inputs read, files and claims included.
    pub done: u64,
    /// How many of them were read without an error.
    pub accepted: u64,
    /// Most bytes allocated at a time.
    pub peak: usize,
    /// CPU seconds of the slowest input: the machine may do other things meanwhile.
    pub slowest: f64,
    /// Seconds in all.
    pub seconds: f64,
    /// Whether it came to its end.
    pub finished: bool,
    /// What was found: the input and what it did.
    pub findings: Vec<String>,
}

/// Reads the inputs of a task. `peak` gives the most bytes that were allocated at a time so far.
pub fn run(task: &Task, peak: fn() -> usize) {
    let folder = scratch_folder();
    (task.reader.prepare)(folder.path());
    let seeds = (task.reader.seeds)();
    let mut worker = Worker::start(task, folder.path(), peak);
    for file in &task.files {
        let bytes = std::fs::read(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        worker.read(&file.display().to_string(), &bytes);
    }
    if task.claims {
        for (name, bytes) in claims(task.reader.name) {
            worker.read(&format!("claim `{name}`"), &bytes);
        }
    }
    for number in task.from..task.from + task.inputs {
        if worker.start.elapsed().as_secs_f64() > task.seconds {
            break;
        }
        worker.progress.next = number + 1;
        worker.read(&number.to_string(), &input(task.reader, &seeds, task.seed, number));
    }
    worker.progress.finished = true;
    worker.save();
}

/// A folder in memory where the system has one: a campaign writes each input to it.
fn scratch_folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    folder.unwrap_or_else(|e| panic!("no temporary folder: {e}"))
}

struct Worker<'a> {
    task: &'a Task,
    folder: &'a Path,
    peak: fn() -> usize,
    start: Instant,
    progress: Progress,
    file: File,
    /// Where panics were met, so that each is kept once.
    places: HashSet<String>,
    last_panic: Arc<Mutex<String>>,
    /// CPU milliseconds of the process at which the present input began.
    began: Arc<AtomicU64>,
}

impl<'a> Worker<'a> {
    fn start(task: &'a Task, folder: &'a Path, peak: fn() -> usize) -> Self {
        let file = File::create(&task.progress).unwrap_or_else(|e| panic!("{}: {e}", task.progress.display()));
        let start = Instant::now();
        let began = Arc::new(AtomicU64::new(0));
        watch(began.clone());
        let last_panic = Arc::new(Mutex::new(String::new()));
        let kept = last_panic.clone();
        std::panic::set_hook(Box::new(move |info| {
            *kept.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ");
        }));
        let progress = Progress { next: task.from, ..Progress::default() };
        Self { task, folder, peak, start, progress, file, places: HashSet::new(), last_panic, began }
    }

    fn read(&mut self, name: &str, bytes: &[u8]) {
        name.clone_into(&mut self.progress.current);
        self.save();
        let before = ProcessTime::now();
        self.began.store(before.as_duration().as_millis() as u64, Ordering::Relaxed);
        let read = catch_unwind(AssertUnwindSafe(|| (self.task.reader.read)(self.folder, bytes)));
        let seconds = before.elapsed().as_secs_f64();
        self.progress.done += 1;
        self.progress.slowest = self.progress.slowest.max(seconds);
        self.progress.seconds = self.start.elapsed().as_secs_f64();
        self.progress.peak = (self.peak)();
        match read {
            Ok(accepted) => self.progress.accepted += u64::from(accepted),
            Err(_) => {
                let panic = self.last_panic.lock().unwrap_or_else(PoisonError::into_inner).clone();
                let place = panic.split(": ").next().unwrap_or_default().to_owned();
                if self.places.insert(place) {
                    keep(self.task, name, bytes);
                    self.progress.findings.push(format!("{name}: {panic}"));
                }
            }
        }
    }

    fn save(&mut self) {
        let mut line = serde_json::to_vec(&self.progress).unwrap_or_default();
        line.push(b'\n');
        let written = self.file.seek(SeekFrom::Start(0)).and_then(|_| self.file.write_all(&line));
        written.unwrap_or_else(|e| panic!("{}: {e}", self.task.progress.display()));
    }
}

/// Puts an input where findings go.
pub(super) fn keep(task: &Task, name: &str, bytes: &[u8]) {
    let name: String = name.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    let path = task.findings.join(format!("{}-{name}", task.reader.name));
    std::fs::create_dir_all(&task.findings)
        .and_then(|()| std::fs::write(&path, bytes))
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
}

/// Ends the process when an input takes too long.
fn watch(began: Arc<AtomicU64>) {
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(250));
            let now = ProcessTime::now().as_duration().as_millis() as u64;
            if now.saturating_sub(began.load(Ordering::Relaxed)) as f64 > 1000.0 * SECONDS_LIMIT {
                eprintln!("slower than {SECONDS_LIMIT} s");
                std::process::abort();
            }
        }
    });
}

/// The last progress that a worker wrote.
pub fn read_progress(path: &Path) -> Option<Progress> {
    let text = std::fs::read_to_string(path).ok()?;
    serde_json::from_str(text.lines().next()?).ok()
}
