//! Progress bars with an ETA, or plain lines where standard error is not a terminal.

use std::io::IsTerminal;
use std::time::{Duration, Instant};

use dvr_train::Observer;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Interval of lines without a terminal.
const LINE_EVERY: Duration = Duration::from_secs(15);

/// Progress of the work, on standard error.
pub struct Progress {
    bar: ProgressBar,
    name: String,
    total: usize,
    terminal: bool,
    last_line: Instant,
}

impl Progress {
    /// Shows nothing until a phase begins.
    pub fn new() -> Self {
        let terminal = std::io::stderr().is_terminal();
        Self { bar: ProgressBar::hidden(), name: String::new(), total: 0, terminal, last_line: Instant::now() }
    }
}

impl Observer for Progress {
    fn phase(&mut self, name: &str, steps: usize) {
        if name == self.name && self.bar.length().is_some() && !self.bar.is_finished() {
            // The same work turned out to be longer or shorter.
            self.total = steps;
            self.bar.set_length(steps as u64);
            return;
        }
        self.bar.finish_and_clear();
        (self.name, self.total) = (name.to_owned(), steps);
        self.last_line = Instant::now();
        if self.terminal {
            let style =
                ProgressStyle::with_template("{prefix} [{bar:30}] {pos}/{len}  {elapsed} of about {eta} left  {msg}");
            self.bar = ProgressBar::with_draw_target(Some(steps as u64), ProgressDrawTarget::stderr());
            if let Ok(style) = style {
                self.bar.set_style(style.progress_chars("=> "));
            }
            self.bar.set_prefix(name.to_owned());
        } else {
            eprintln!("{name}{}", if steps > 1 { format!(" ({steps} steps)") } else { String::new() });
        }
    }

    fn progress(&mut self, done: usize, message: &str) {
        if self.terminal {
            self.bar.set_position(done as u64);
            self.bar.set_message(message.to_owned());
            if done == self.total {
                self.bar.finish_and_clear();
                eprintln!("{}: {done} done in {}  {message}", self.name, indicatif::HumanDuration(self.bar.elapsed()));
            }
        } else if self.last_line.elapsed() >= LINE_EVERY || done == self.total {
            self.last_line = Instant::now();
            eprintln!("{} {done}/{}  {message}", self.name, self.total);
        }
    }

    fn note(&mut self, line: &str) {
        self.bar.suspend(|| eprintln!("note: {line}"));
    }
}
