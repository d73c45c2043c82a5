//! A child: it is started in a group of its own, its streams are read by threads, and it is asked every few milliseconds
//! whether it has ended, or is to.

use std::io::Read;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::spawn;
use std::time::{Duration, Instant};

use dvr_core::Cancellation;

use crate::deadlock::Watch;
use crate::error::ProgramError;

/// Interval of looking whether the work is to end.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// How long a program may take to end when it is asked to.
const TO_END: Duration = Duration::from_secs(1);

/// How long what a program said at its end may take to arrive, where something that it started keeps its output open.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// Lines and pieces that may wait to be heard; a program that is faster waits itself.
const WAITING: usize = 64;

/// What a program's standard output is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stdout {
    /// Lines of text.
    Lines,
    /// Bytes, as of a picture.
    Bytes,
}

/// How long a program is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Patience {
    /// For as long as it takes.
    Endless,
    /// Until all its threads have waited for each other for half a minute, in which it said nothing (on Linux; elsewhere, for
    /// as long as it takes). It must not wait by shared memory for another program, which looks the same.
    UntilDeadlock,
}

/// What a program gives out.
#[derive(Clone, Copy, Debug)]
pub enum Heard<'a> {
    /// A line of its standard output.
    Out(&'a str),
    /// A line of its standard error.
    Err(&'a str),
    /// A piece of its standard output.
    Bytes(&'a [u8]),
}

/// The same on its way from the thread that reads it.
enum Said {
    Out(String),
    Err(String),
    Bytes(Vec<u8>),
}

/// Runs a program to its end, with nothing at its standard input; `heard` gets what it gives out. Lines end by a line feed
/// or a carriage return.
///
/// A program that is to end is asked to (SIGTERM), together with all that it has started, and ended after a second where it
/// does not. There is a [`Shield`](dvr_core::Shield) for as long as there is a child.
///
/// # Errors
/// [`ProgramError::NotStarted`] and [`ProgramError::Failed`]; [`ProgramError::Cancelled`] and [`ProgramError::Deadlocked`],
/// after it was ended.
pub fn run(
    command: &mut Command,
    stdout: Stdout,
    patience: Patience,
    cancellation: &Cancellation,
    heard: &mut dyn FnMut(Heard<'_>),
) -> Result<(), ProgramError> {
    cancellation.check()?;
    // A program that ends itself waits for as long as there is a child to end.
    let _shield = cancellation.shield();
    let spawned = own_group(command).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = spawned.map_err(ProgramError::NotStarted)?;
    let (sender, said) = sync_channel(WAITING);
    if let Some(stream) = child.stdout.take() {
        let sender = sender.clone();
        match stdout {
            Stdout::Lines => follow(stream, sender, Said::Out),
            Stdout::Bytes => pass_on(stream, sender),
        }
    }
    if let Some(stream) = child.stderr.take() {
        follow(stream, sender, Said::Err);
    }
    // What a program leaves in the background may hold its output open for good.
    let mut over: Option<Instant> = None;
    let mut watch = Watch::new();
    loop {
        if cancellation.is_cancelled() {
            end(&mut child);
            return Err(dvr_core::Cancelled.into());
        }
        let next = said.recv_timeout(LOOK_EVERY);
        if next.is_ok() {
            watch.heard();
        }
        match next {
            Ok(Said::Out(line)) => heard(Heard::Out(&line)),
            Ok(Said::Err(line)) => heard(Heard::Err(&line)),
            Ok(Said::Bytes(bytes)) => heard(Heard::Bytes(&bytes)),
            Err(RecvTimeoutError::Timeout) => {
                if over.is_none() && child.try_wait().map_err(ProgramError::NotHeard)?.is_some() {
                    over = Some(Instant::now());
                }
                if over.is_some_and(|since| since.elapsed() > LAST_WORDS) {
                    break;
                }
                if patience == Patience::UntilDeadlock && over.is_none() && watch.is_deadlocked(child.id()) {
                    end(&mut child);
                    return Err(ProgramError::Deadlocked);
                }
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let status = ended(&mut child, cancellation)?;
    if status.success() {
        return Ok(());
    }
    // Ctrl-C in a terminal ends both, and the child may be first.
    std::thread::sleep(LOOK_EVERY);
    cancellation.check()?;
    Err(ProgramError::Failed(status))
}

/// How a child that says nothing any more ends.
fn ended(child: &mut Child, cancellation: &Cancellation) -> Result<ExitStatus, ProgramError> {
    loop {
        if let Some(status) = child.try_wait().map_err(ProgramError::NotHeard)? {
            return Ok(status);
        }
        if cancellation.is_cancelled() {
            end(child);
            return Err(dvr_core::Cancelled.into());
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Sends the lines of a stream. COLMAP ends some of its lines by a carriage return, and so do bars of progress.
fn follow(mut stream: impl Read + Send + 'static, lines: SyncSender<Said>, said: fn(String) -> Said) {
    spawn(move || {
        let (mut line, mut buffer) = (Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = stream.read(&mut buffer) {
            for &byte in &buffer[..count] {
                if byte == b'\n' || byte == b'\r' {
                    // Nobody listens any more where the work was ended.
                    let _ = lines.send(said(String::from_utf8_lossy(&line).into_owned()));
                    line.clear();
                } else {
                    line.push(byte);
                }
            }
        }
        if !line.is_empty() {
            let _ = lines.send(said(String::from_utf8_lossy(&line).into_owned()));
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

/// The command line, as it could be typed.
pub fn in_words(command: &Command) -> String {
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
    while asked.elapsed() < TO_END && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(LOOK_EVERY);
    }
    let _ = send(Signal::SIGKILL);
    let _ = child.wait();
}

#[cfg(not(unix))]
fn end(child: &mut Child) {
    let asked = Instant::now();
    let _ = child.kill();
    while asked.elapsed() < TO_END && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(LOOK_EVERY);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use dvr_test_support::{test_with, wait_channels};

    use super::*;

    /// How a script ends, and its lines, those of standard error with a `!` before them.
    fn shell(script: &str, cancellation: &Cancellation) -> (Result<(), ProgramError>, Vec<String>) {
        let mut lines = Vec::new();
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let result =
            run(&mut command, Stdout::Lines, Patience::UntilDeadlock, cancellation, &mut |heard| match heard {
                Heard::Out(line) => lines.push(line.to_owned()),
                Heard::Err(line) => lines.push(format!("!{line}")),
                Heard::Bytes(_) => {}
            });
        (result, lines)
    }

    #[test]
    fn lines_of_both_streams_are_heard_and_told_apart() {
        let (result, mut lines) = shell("printf 'a\\rb\\n'; echo c >&2; printf d", &Cancellation::default());
        result.unwrap();
        lines.sort();
        assert_eq!(lines, ["!c", "a", "b", "d"]);
    }

    #[test]
    fn what_goes_on_in_the_background_is_not_waited_for() {
        let begun = Instant::now();
        let (result, lines) = shell("sleep 60 & echo begun", &Cancellation::default());
        result.unwrap();
        assert_eq!(lines, ["begun"]);
        assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    }

    #[test]
    fn failures_say_how_a_program_ended() {
        let (result, _) = shell("exit 3", &Cancellation::default());
        assert_eq!(result.unwrap_err().to_string(), "exit status: 3");
        let (result, _) = shell("kill -SEGV $$", &Cancellation::default());
        assert!(result.unwrap_err().to_string().contains("signal: 11"));
        let missing = run(
            &mut Command::new("/no/such/program"),
            Stdout::Lines,
            Patience::Endless,
            &Cancellation::default(),
            &mut |_| (),
        );
        assert!(matches!(missing, Err(ProgramError::NotStarted(_))), "{missing:?}");
    }

    /// A child whose threads wait for each other: the test for the channel, and the harness for the test.
    #[test_with(wait_channels)]
    fn a_program_that_waits_for_itself_is_ended() {
        wait_channels();
        const ENDLESS: &str = "DVR_TEST_WAITS_FOR_ITSELF";
        if std::env::var_os(ENDLESS).is_some() {
            let (_sender, receiver) = std::sync::mpsc::channel::<()>();
            // It ends, should nobody end it.
            let _ = receiver.recv_timeout(Duration::from_secs(60));
        }
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["a_program_that_waits_for_itself_is_ended", "--nocapture"]).env(ENDLESS, "1");
        let begun = Instant::now();
        let ended = run(&mut command, Stdout::Lines, Patience::UntilDeadlock, &Cancellation::default(), &mut |_| ());
        assert!(matches!(ended, Err(ProgramError::Deadlocked)), "{ended:?}");
        assert!(begun.elapsed() >= Duration::from_secs(4), "{:?}", begun.elapsed());
        // One that sleeps is waited for.
        shell("sleep 8", &Cancellation::default()).0.unwrap();
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
        assert!(matches!(result, Err(ProgramError::Cancelled(_))), "{result:?}");
        assert_eq!(lines, ["started"]);
        assert!(canceller.join().unwrap() && !cancellation.is_shielded());
        std::thread::sleep(Duration::from_millis(2300));
        assert!(!mark.exists(), "the grandchild went on");
    }
}
