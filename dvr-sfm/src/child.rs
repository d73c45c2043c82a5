//! Programs that are run: what they say is logged and followed, and they end when the work is to end.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::spawn;
use std::time::{Duration, Instant};

use dvr_core::Cancellation;

use crate::error::{Result, SfmError};

/// Interval of looking whether the work is to end.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// How long a program may take to end when it is asked to.
const PATIENCE: Duration = Duration::from_secs(1);

/// Lines and pieces that may wait to be heard; a program that is faster waits itself.
const WAITING: usize = 64;

/// All that programs said.
pub(crate) struct Log {
    pub path: PathBuf,
    /// `None` keeps nothing.
    file: Option<File>,
}

impl Log {
    /// Opens a log, behind what it holds.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::options().create(true).append(true).open(path);
        let file = file.map_err(|source| dvr_core::Error::Io { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), file: Some(file) })
    }

    /// A log that keeps nothing, of what only this program wants to know.
    pub fn none() -> Self {
        Self { path: PathBuf::new(), file: None }
    }

    /// A line. One that cannot be written is lost: the disk says so where it matters.
    fn line(&mut self, line: &str) {
        if let Some(file) = &mut self.file {
            let _ = writeln!(file, "{line}");
        }
    }
}

/// What is run.
#[derive(Clone, Copy)]
pub(crate) struct Task {
    pub program: &'static str,
    pub step: &'static str,
    /// Its standard output is bytes, and no lines.
    pub takes_bytes: bool,
}

/// What a program gives out.
pub(crate) enum Heard<'a> {
    /// A line.
    Line(&'a str),
    /// A piece of its standard output.
    Bytes(&'a [u8]),
}

/// The same on its way from the thread that reads it.
enum Said {
    Line(String),
    Bytes(Vec<u8>),
}

/// Runs a program to its end; `heard` gets what it gives out.
///
/// # Errors
/// [`SfmError::Failed`] where it cannot be started, or does not end with success; [`SfmError::Cancelled`], after it was
/// ended.
pub(crate) fn run(
    command: &mut Command,
    task: Task,
    log: &mut Log,
    cancellation: &Cancellation,
    heard: &mut dyn FnMut(Heard<'_>),
) -> Result<()> {
    cancellation.check()?;
    // A program that ends itself waits for as long as there is a child to end.
    let _shield = cancellation.shield();
    log.line(&format!("\n$ {}", in_words(command)));
    let failed = |how: String, said: String, log: &Log| {
        Err(SfmError::Failed { program: task.program, step: task.step, how, said, log: log.path.clone() })
    };
    let spawned = own_group(command).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = match spawned {
        Ok(child) => child,
        Err(error) => return failed("it could not be started".to_owned(), error.to_string(), log),
    };
    let (sender, lines) = sync_channel(WAITING);
    if let Some(stdout) = child.stdout.take() {
        let sender = sender.clone();
        if task.takes_bytes { pass_on(stdout, sender) } else { follow(stdout, sender) }
    }
    if let Some(stderr) = child.stderr.take() {
        follow(stderr, sender);
    }
    let mut words = LastWords::default();
    loop {
        if cancellation.is_cancelled() {
            end(&mut child);
            log.line("(ended)");
            return Err(dvr_core::Cancelled.into());
        }
        match lines.recv_timeout(LOOK_EVERY) {
            Ok(Said::Line(line)) => {
                log.line(&line);
                words.hear(&line);
                heard(Heard::Line(&line));
            }
            Ok(Said::Bytes(bytes)) => heard(Heard::Bytes(&bytes)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let status = match ended(&mut child, cancellation) {
        Ok(Some(status)) => status,
        Ok(None) => return Err(dvr_core::Cancelled.into()),
        Err(error) => return failed("its end was not heard".to_owned(), error.to_string(), log),
    };
    if status.success() {
        return Ok(());
    }
    // Ctrl-C in a terminal ends both, and the child may be first.
    std::thread::sleep(LOOK_EVERY);
    cancellation.check()?;
    failed(status.to_string(), words.said(), log)
}

/// How a child that says nothing any more ends; `None` where it was ended.
fn ended(child: &mut Child, cancellation: &Cancellation) -> std::io::Result<Option<std::process::ExitStatus>> {
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        if cancellation.is_cancelled() {
            end(child);
            return Ok(None);
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Sends the lines of a stream. COLMAP ends some of its lines by a carriage return.
fn follow(mut stream: impl Read + Send + 'static, lines: SyncSender<Said>) {
    spawn(move || {
        let (mut line, mut buffer) = (Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            for &byte in &buffer[..count] {
                if byte == b'\n' || byte == b'\r' {
                    // Nobody listens any more where the work was ended.
                    let _ = lines.send(Said::Line(String::from_utf8_lossy(&line).into_owned()));
                    line.clear();
                } else {
                    line.push(byte);
                }
            }
        }
        if !line.is_empty() {
            let _ = lines.send(Said::Line(String::from_utf8_lossy(&line).into_owned()));
        }
    });
}

/// Sends what a stream holds.
fn pass_on(mut stream: impl Read + Send + 'static, pieces: SyncSender<Said>) {
    spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            // Nobody listens any more where the work was ended.
            if pieces.send(Said::Bytes(buffer[..count].to_vec())).is_err() {
                return;
            }
        }
    });
}

/// What a program said last, for the one who asks why it failed.
#[derive(Default)]
struct LastWords {
    error: Option<String>,
    last: String,
}

impl LastWords {
    fn hear(&mut self, line: &str) {
        let line = line.trim();
        if line.is_empty() || line.chars().all(|c| c == '=' || c == '-') {
            return;
        }
        let is_error =
            ["ERROR", "Check failed", "error:", "Error", "terminate called"].iter().any(|e| line.contains(e));
        if is_error && self.error.is_none() {
            self.error = Some(line.to_owned());
        }
        line.clone_into(&mut self.last);
    }

    /// The first error, or else the last line.
    fn said(self) -> String {
        let said = self.error.unwrap_or(self.last);
        let short: String = said.trim_end_matches('.').chars().take(300).collect();
        if short.is_empty() { "it said nothing".to_owned() } else { short }
    }
}

/// The command line, as it could be typed.
fn in_words(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
}

/// In a group of its own, so that it is ended with all that it has started.
#[cfg(unix)]
fn own_group(command: &mut Command) -> &mut Command {
    use std::os::unix::process::CommandExt;
    command.process_group(0)
}

#[cfg(not(unix))]
fn own_group(command: &mut Command) -> &mut Command {
    command
}

/// Asks a child and its children to end, and ends them where they take too long.
#[cfg(unix)]
fn end(child: &mut Child) {
    use nix::sys::signal::{Signal, killpg};
    use nix::unistd::Pid;
    // A group that is gone does not hear it.
    let group = i32::try_from(child.id()).ok().map(Pid::from_raw);
    let send = |signal| group.map(|group| killpg(group, signal));
    let _ = send(Signal::SIGTERM);
    let asked = Instant::now();
    while asked.elapsed() < PATIENCE && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(LOOK_EVERY);
    }
    let _ = send(Signal::SIGKILL);
    let _ = child.wait();
}

#[cfg(not(unix))]
fn end(child: &mut Child) {
    let asked = Instant::now();
    let _ = child.kill();
    while asked.elapsed() < PATIENCE && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(LOOK_EVERY);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    const TASK: Task = Task { program: "colmap", step: "features", takes_bytes: false };

    fn shell(script: &str, cancellation: &Cancellation) -> (Result<()>, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(&folder.path().join("log")).unwrap();
        let mut lines = Vec::new();
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let result = run(&mut command, TASK, &mut log, cancellation, &mut |heard| {
            if let Heard::Line(line) = heard {
                lines.push(line.to_owned());
            }
        });
        let logged = std::fs::read_to_string(&log.path).unwrap();
        assert!(lines.iter().all(|line| logged.contains(line)), "{logged}");
        (result, lines)
    }

    #[test]
    fn lines_of_both_streams_are_heard_and_a_failure_gives_the_first_error() {
        let (result, lines) = shell("printf 'a\\rb\\n'; echo c >&2; printf d", &Cancellation::default());
        result.unwrap();
        let mut sorted = lines;
        sorted.sort();
        assert_eq!(sorted, ["a", "b", "c", "d"]);
        let (result, _) = shell("echo ERROR: no database; echo bye; exit 3", &Cancellation::default());
        let error = result.unwrap_err().to_string();
        assert!(error.contains("colmap failed at features (exit status: 3): ERROR: no database."), "{error}");
        let (result, _) = shell("kill -SEGV $$", &Cancellation::default());
        assert!(result.unwrap_err().to_string().contains("signal: 11"));
    }

    #[test]
    fn a_child_and_its_children_end_with_the_work() {
        let cancellation = Cancellation::default();
        let token = cancellation.clone();
        let canceller = spawn(move || {
            std::thread::sleep(Duration::from_millis(300));
            token.cancel()
        });
        let folder = tempfile::tempdir().unwrap();
        let mark = folder.path().join("mark");
        // The grandchild would leave its mark after two seconds.
        let script = format!("(sleep 2; touch {}) & echo started; wait", mark.display());
        let (result, lines) = shell(&script, &cancellation);
        assert!(matches!(result, Err(SfmError::Cancelled(_))), "{result:?}");
        assert_eq!(lines, ["started"]);
        assert!(canceller.join().unwrap() && !cancellation.is_shielded());
        std::thread::sleep(Duration::from_millis(2300));
        assert!(!mark.exists(), "the grandchild went on");
    }
}
