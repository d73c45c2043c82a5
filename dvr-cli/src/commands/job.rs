//! Trainings as separate processes, the same commands that a user would give: no caches are warm, times are their own,
//! and a failure does not end the others. Results are stored and not computed again.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use dvr_core::files::write_bytes_atomically;
use dvr_train::{RunFolder, RunMetrics};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::args::Variant;

/// A training to run.
pub struct Job<'a> {
    /// The scene.
    pub scene: &'a Path,
    /// Its run folder, which is replaced.
    pub folder: &'a RunFolder,
    /// How to reconstruct.
    pub variant: &'a Variant,
    /// What supervises it.
    pub supervision: &'a str,
    /// Seed of all random choices.
    pub seed: u64,
    /// Time limit of training.
    pub time: Option<Duration>,
    /// Whether Chamfer-L1 is measured at each validation.
    pub follow_shape: bool,
}

/// How a training ended.
pub enum Ended {
    /// With figures, possibly without a mesh.
    Measured {
        /// The figures.
        metrics: Box<RunMetrics>,
        /// Wall seconds from the start of the program to its end.
        seconds: f64,
    },
    /// Without figures.
    Failed {
        /// The error that it printed last.
        said: String,
        /// Its exit code; `None` where a signal ended it.
        code: Option<i32>,
    },
}

impl Job<'_> {
    /// Runs the training.
    pub fn run(&self) -> Result<Ended> {
        let start = Instant::now();
        let mut command = Command::new(std::env::current_exe().context("this program cannot be started again")?);
        command.arg("train").arg(self.scene).arg("--out").arg(self.folder.root()).args(["--overwrite", "--no-report"]);
        command.args(["--method", &self.variant.method, "--seed", &self.seed.to_string()]);
        if self.variant.method != "hull" {
            command.args(["--supervision", self.supervision]);
        }
        for setting in &self.variant.settings {
            match setting.strip_prefix("refine_cameras=") {
                // An option of the run rather than a setting of the method.
                Some(rounds) => command.args(["--refine-cameras", rounds]),
                None => command.args(["--set", setting]),
            };
        }
        if self.follow_shape {
            command.arg("--follow-shape");
        }
        if let Some(time) = self.time {
            command.args(["--time", &format!("{}s", time.as_secs_f64())]);
        }
        let output = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).output()?;
        let seconds = start.elapsed().as_secs_f64();
        // A run without a mesh writes its figures and fails; other failures write none.
        let metrics = std::fs::read_to_string(self.folder.metrics_json()).ok();
        let metrics: Option<RunMetrics> = metrics.and_then(|text| serde_json::from_str(&text).ok());
        Ok(match metrics {
            Some(metrics) => Ended::Measured { metrics: Box::new(metrics), seconds },
            None => {
                let said = String::from_utf8_lossy(&output.stderr);
                let is_error = |line: &&str| line.starts_with("error: ");
                let said = said.lines().rfind(is_error).or(said.lines().last()).unwrap_or("no message").to_owned();
                Ended::Failed { said, code: output.status.code() }
            }
        })
    }
}

/// The value stored at `path`, or else the value of `make`, which is stored there. Either way it is read from JSON:
/// numbers may differ in their last digit from those that were written.
pub fn once<T: Serialize + DeserializeOwned>(path: &Path, make: impl FnOnce() -> Result<T>) -> Result<T> {
    if let Some(stored) = stored(path)? {
        return Ok(stored);
    }
    let text = serde_json::to_string_pretty(&make()?)?;
    write_bytes_atomically(path, text.as_bytes())?;
    Ok(serde_json::from_str(&text)?)
}

/// The value stored at `path`, if there is one.
pub fn stored<T: DeserializeOwned>(path: &Path) -> Result<Option<T>> {
    let Ok(text) = std::fs::read_to_string(path) else { return Ok(None) };
    serde_json::from_str(&text).map(Some).with_context(|| format!("{} is damaged; remove it", path.display()))
}
