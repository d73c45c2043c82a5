//! A campaign: workers over readers, started again behind an input that killed them, and the table of what they did.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

use super::worker::{Progress, read_progress};
use super::{READERS, Reader, input};

/// What is to be done.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The program whose arguments are those of `worker_arguments`.
    pub program: PathBuf,
    /// Names of the readers; empty means all.
    pub readers: Vec<String>,
    /// Seed of the inputs.
    pub seed: u64,
    /// Number of the first input.
    pub from: u64,
    /// Inputs per reader.
    pub inputs: u64,
    /// Seconds per reader after which it is left all the same.
    pub seconds: f64,
    /// Files that once broke a reader, in a folder of the reader's name below this one.
    pub regressions: Option<PathBuf>,
    /// Where inputs that break something are put.
    pub findings: PathBuf,
}

/// What became of a reader.
#[derive(Clone, Debug, Default)]
pub struct Row {
    /// The reader.
    pub reader: &'static str,
    /// The sums over its workers.
    pub total: Progress,
}

/// The most workers of a reader that may die.
const MOST_DEATHS: usize = 20;

/// Runs the plan; `heard` gets each row as it is done.
pub fn run(plan: &Plan, mut heard: impl FnMut(&Row)) -> Vec<Row> {
    let chosen = |reader: &&Reader| plan.readers.is_empty() || plan.readers.iter().any(|name| name == reader.name);
    let mut rows = Vec::new();
    for reader in READERS.iter().filter(chosen) {
        let row = run_reader(plan, reader);
        heard(&row);
        rows.push(row);
    }
    rows
}

fn run_reader(plan: &Plan, reader: &'static Reader) -> Row {
    let mut row = Row { reader: reader.name, total: Progress { next: plan.from, ..Progress::default() } };
    let end = plan.from + plan.inputs;
    let mut files = regression_files(plan, reader);
    let mut claims = true;
    for _ in 0..MOST_DEATHS {
        let scratch = tempfile::tempdir().unwrap_or_else(|e| panic!("no temporary folder: {e}"));
        let progress = scratch.path().join("progress");
        let left = plan.seconds - row.total.seconds;
        let mut command = Command::new(&plan.program);
        command.args(["worker", reader.name]);
        command.args(["--seed", &plan.seed.to_string(), "--from", &row.total.next.to_string()]);
        command.args(["--inputs", &(end - row.total.next).to_string(), "--seconds", &left.to_string()]);
        command.arg("--findings").arg(&plan.findings).arg("--progress").arg(&progress);
        command.args(files.iter().flat_map(|file| ["--file".as_ref(), file.as_os_str()]));
        if claims {
            command.arg("--claims");
        }
        // One thread: what rayon would do beside would count for another input.
        let output = command.env("RAYON_NUM_THREADS", "1").stdout(Stdio::null()).output();
        let output = output.unwrap_or_else(|e| panic!("{}: {e}", plan.program.display()));
        let found = read_progress(&progress).unwrap_or_default();
        add(&mut row.total, &found);
        if output.status.success() && found.finished {
            break;
        }
        let said = String::from_utf8_lossy(&output.stderr);
        row.total.findings.push(format!("{}: {}", found.current, death(output.status, &said)));
        keep_killer(plan, reader, &found);
        // A worker that died among files or claims leaves the rest of them unread: each is tried in its own turn.
        match files.iter().position(|file| file.display().to_string() == found.current) {
            Some(at) => files = files.split_off(at + 1),
            None => {
                files.clear();
                claims = false;
            }
        }
        row.total.next = row.total.next.max(found.next);
    }
    row
}

/// The regression files of a reader, in order.
fn regression_files(plan: &Plan, reader: &Reader) -> Vec<PathBuf> {
    let Some(folder) = plan.regressions.as_ref().map(|folder| folder.join(reader.name)) else { return Vec::new() };
    let mut files: Vec<PathBuf> =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}

fn add(total: &mut Progress, found: &Progress) {
    total.done += found.done;
    total.accepted += found.accepted;
    total.peak = total.peak.max(found.peak);
    total.slowest = total.slowest.max(found.slowest);
    total.seconds += found.seconds;
    total.next = total.next.max(found.next);
    total.findings.extend(found.findings.iter().cloned());
}

fn death(status: ExitStatus, said: &str) -> String {
    let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
    format!("the process died ({status}): {last}")
}

/// Puts the input that killed a worker where findings go.
fn keep_killer(plan: &Plan, reader: &'static Reader, found: &Progress) {
    let bytes = match found.current.parse::<u64>() {
        Ok(number) => input(reader, &(reader.seeds)(), plan.seed, number),
        Err(_) => return,
    };
    let path = plan.findings.join(format!("{}-{}", reader.name, found.current));
    std::fs::create_dir_all(&plan.findings)
        .and_then(|()| std::fs::write(&path, bytes))
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
}

/// The table of a campaign, as Markdown.
pub fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "| reader | inputs | read without an error | inputs per second | peak memory, MB | slowest, s | findings |\n\
         |---|---:|---:|---:|---:|---:|---:|\n",
    );
    let mut sums = (0, 0, 0.0, 0, 0.0f64, 0);
    let mut line = |name: &str, done: u64, accepted: u64, seconds: f64, peak: usize, slowest: f64, findings: usize| {
        let (rate, peak) = (done as f64 / seconds.max(1e-9), peak as f64 / 1e6);
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| {name} | {done} | {accepted} | {rate:.0} | {peak:.0} | {slowest:.2} | {findings} |");
    };
    for Row { reader, total } in rows {
        line(reader, total.done, total.accepted, total.seconds, total.peak, total.slowest, total.findings.len());
        sums = (
            sums.0 + total.done,
            sums.1 + total.accepted,
            sums.2 + total.seconds,
            sums.3.max(total.peak),
            sums.4.max(total.slowest),
            sums.5 + total.findings.len(),
        );
    }
    line("**all**", sums.0, sums.1, sums.2, sums.3, sums.4, sums.5);
    text
}

/// How an input is read again.
pub fn reproduction(program: &Path, row: &Row, finding: &str, seed: u64) -> String {
    let current = finding.split(": ").next().unwrap_or_default();
    match current.parse::<u64>() {
        Ok(number) => {
            format!("{} --reader {} --seed {seed} --from {number} --inputs 1", program.display(), row.reader)
        }
        Err(_) => format!("{} --reader {} --inputs 0", program.display(), row.reader),
    }
}
