//! COLMAP and ffmpeg as they are run here: what they say is logged, and a failure tells their last words.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use dvr_core::Cancellation;
use dvr_program::{Patience, ProgramError, Stdout, in_words};

use crate::error::{Result, SfmError};

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
    pub fn line(&mut self, line: &str) {
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

/// How often COLMAP is started again where it hangs: what it has written, it goes on from or writes again.
const TRIES: usize = 3;

/// Runs a program to its end; `heard` gets what it gives out. COLMAP is run again where it hangs.
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
    let stdout = if task.takes_bytes { Stdout::Bytes } else { Stdout::Lines };
    let mut tries = 0;
    let (how, said) = loop {
        cancellation.check()?;
        tries += 1;
        log.line(&format!("\n$ {}", in_words(command)));
        let mut words = LastWords::default();
        let ended = dvr_program::run(command, stdout, Patience::UntilDeadlock, cancellation, &mut |said| match said {
            dvr_program::Heard::Out(line) | dvr_program::Heard::Err(line) => {
                log.line(line);
                words.hear(line);
                heard(Heard::Line(line));
            }
            dvr_program::Heard::Bytes(bytes) => heard(Heard::Bytes(bytes)),
        });
        match ended {
            Ok(()) => return Ok(()),
            Err(ProgramError::Cancelled(cancelled)) => {
                log.line("(ended)");
                return Err(cancelled.into());
            }
            Err(ProgramError::Deadlocked) if task.program == "colmap" && tries < TRIES => log.line("(it hung)"),
            Err(ProgramError::Deadlocked) => break ("it hung".to_owned(), words.said()),
            Err(ProgramError::NotStarted(error)) => break ("it could not be started".to_owned(), error.to_string()),
            Err(ProgramError::NotHeard(error)) => break ("its end was not heard".to_owned(), error.to_string()),
            Err(ProgramError::Failed(status)) => break (status.to_string(), words.said()),
        }
    };
    Err(SfmError::Failed { program: task.program, step: task.step, how, said, log: log.path.clone() })
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

#[cfg(all(test, unix))]
mod tests {
    use dvr_test_support::{test_with, wait_channels};

    use super::*;

    const TASK: Task = Task { program: "colmap", step: "features", takes_bytes: false };

    fn shell(script: &str) -> (Result<()>, Vec<String>) {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(&folder.path().join("log")).unwrap();
        let mut lines = Vec::new();
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let result = run(&mut command, TASK, &mut log, &Cancellation::default(), &mut |heard| {
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
        let (result, mut lines) = shell("printf 'a\\rb\\n'; echo c >&2; printf d");
        result.unwrap();
        lines.sort();
        assert_eq!(lines, ["a", "b", "c", "d"]);
        let (result, _) = shell("echo ERROR: no database; echo bye; exit 3");
        let error = result.unwrap_err().to_string();
        assert!(error.contains("colmap failed at features (exit status: 3): ERROR: no database."), "{error}");
        let (result, _) = shell("kill -SEGV $$");
        assert!(result.unwrap_err().to_string().contains("signal: 11"));
    }

    /// COLMAP, as this test itself plays it: the first time, its threads wait for each other for good.
    #[test_with(wait_channels)]
    fn colmap_that_hangs_is_run_again() {
        wait_channels();
        const MARK: &str = "DVR_TEST_HANGS_WITHOUT";
        if let Some(mark) = std::env::var_os(MARK) {
            if !Path::new(&mark).exists() {
                std::fs::write(mark, "").unwrap();
                let (_sender, receiver) = std::sync::mpsc::channel::<()>();
                // It ends, should nobody end it.
                let _ = receiver.recv_timeout(std::time::Duration::from_secs(90));
                panic!("nobody ended it");
            }
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(&folder.path().join("log")).unwrap();
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["colmap_that_hangs_is_run_again", "--nocapture"]).env(MARK, folder.path().join("mark"));
        run(&mut command, TASK, &mut log, &Cancellation::default(), &mut |_| ()).unwrap();
        let logged = std::fs::read_to_string(&log.path).unwrap();
        assert_eq!(logged.matches("(it hung)").count(), 1, "{logged}");
    }
}
