//! Trainings as separate processes, the same commands that a user would give: no caches are warm, times are their own,
//! and a failure does not end the others.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::Parser;
use dvr_core::Cancellation;
use dvr_core::record::{Digest, RecordKey};
use dvr_train::{RunFolder, RunMetrics};
use serde_json::{Value, json};

use super::child::{EndedChild, run_child};
use super::method_of_args::method_of_args;
use super::provenance::record_key;
use super::{SCENE_RESOLUTION, SceneReading, mesh_options};
use crate::args::{self, Cli, TrainArgs, Variant};

/// Starts the setting of a variant that names another program, such as an earlier build of this one.
const PROGRAM: &str = "program=";

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
    /// How many pixels along each axis are averaged into one, where it is not one.
    pub downscale: Option<u32>,
    /// Time limit of training.
    pub time: Option<Duration>,
    /// Whether Chamfer-L1 is measured at each validation.
    pub follow_shape: bool,
    /// Ends it early.
    pub cancellation: &'a Cancellation,
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
    /// As a failure.
    Failed {
        /// The error that it printed last.
        said: String,
        /// Its exit code; `None` where a signal ended it.
        code: Option<i32>,
    },
}

impl Job<'_> {
    /// Runs the training.
    ///
    /// # Errors
    /// When it cannot be started, an earlier run's figures cannot be removed, or somebody wanted it to end.
    pub fn run(&self) -> Result<Ended> {
        let program = match self.program() {
            Some(program) => std::path::absolute(program)?,
            None => std::env::current_exe().context("this program cannot be started again")?,
        };
        self.run_by(&program)
    }

    /// The program that trains, where it is not this one.
    fn program(&self) -> Option<&Path> {
        self.variant.settings.iter().find_map(|setting| setting.strip_prefix(PROGRAM)).map(Path::new)
    }

    /// Runs the training by a program.
    fn run_by(&self, program: &Path) -> Result<Ended> {
        // Figures that lie there are another run's.
        let figures = self.folder.metrics_json();
        if figures.exists() {
            std::fs::remove_file(&figures).with_context(|| figures.display().to_string())?;
        }
        let start = Instant::now();
        let mut command = Command::new(program);
        command.args(self.arguments());
        let EndedChild { status, said } = run_child(&mut command, self.cancellation)?;
        self.cancellation.check()?;
        let seconds = start.elapsed().as_secs_f64();
        let metrics = std::fs::read_to_string(&figures).ok().and_then(|text| serde_json::from_str(&text).ok());
        Ok(match metrics {
            Some(metrics) if is_measured(status, &metrics) => Ended::Measured { metrics: Box::new(metrics), seconds },
            _ => Ended::Failed { said: last_words(&said, status), code: status.code() },
        })
    }

    /// The command line after the program's name.
    fn arguments(&self) -> Vec<OsString> {
        let mut arguments: Vec<OsString> = vec!["train".into(), self.scene.into()];
        let mut add = |parts: &[&str]| arguments.extend(parts.iter().map(OsString::from));
        add(&["--overwrite", "--no-report", "--method", &self.variant.method, "--seed", &self.seed.to_string()]);
        if self.variant.method != "hull" {
            add(&["--supervision", self.supervision]);
        }
        for setting in self.variant.settings.iter().filter(|setting| !setting.starts_with(PROGRAM)) {
            match setting.strip_prefix("refine_cameras=") {
                // An option of the run rather than a setting of the method.
                Some(rounds) => add(&["--refine-cameras", rounds]),
                None => add(&["--set", setting]),
            }
        }
        if let Some(pixels) = self.downscale {
            add(&["--downscale", &pixels.to_string()]);
        }
        if self.follow_shape {
            add(&["--follow-shape"]);
        }
        if let Some(time) = self.time {
            add(&["--time", &format!("{}s", time.as_secs_f64())]);
        }
        arguments.extend(["--out".into(), self.folder.root().into()]);
        arguments
    }

    /// All settings of the run, defaults included.
    ///
    /// # Errors
    /// When the training would refuse them.
    pub fn settings(&self) -> Result<Value> {
        let arguments = [OsString::from("dvr")].into_iter().chain(self.arguments());
        let args::Command::Train(train) = Cli::try_parse_from(arguments)?.command else { bail!("no training") };
        let TrainArgs { refine_cameras, follow_shape, time, .. } = *train;
        Ok(json!({
            "method": method_of_args(&train, false)?.record()?,
            "reading": SceneReading::of_arguments(&train.reading),
            "meshing": format!("{:?}", mesh_options(&train.meshing, SCENE_RESOLUTION, &Cancellation::default())),
            "refine_cameras": refine_cameras,
            "follow_shape": follow_shape,
            "time": time,
        }))
    }

    /// The key of a row of this training on a scene, with these settings: [`Job::settings`], and what else is measured. Another
    /// program that trains is named by its file.
    ///
    /// # Errors
    /// When the file of a program cannot be read.
    pub fn record_key(&self, scene: Digest, settings: &Value) -> Result<RecordKey> {
        let mut key = record_key(scene, settings, "cpu")?;
        if let Some(program) = self.program() {
            let digest = Digest::of_file(program).with_context(|| format!("{PROGRAM}{}", program.display()))?;
            let name = program.file_name().unwrap_or(program.as_os_str()).to_string_lossy();
            key.program += &format!(", trained by {name} (binary {digest})");
        }
        Ok(key)
    }
}

/// Whether figures count: of a run that succeeded, or of one that ended by itself because there is no surface.
fn is_measured(status: ExitStatus, metrics: &RunMetrics) -> bool {
    let is_without_mesh = status.code() == Some(i32::from(crate::EXIT_BAD_INPUT)) && metrics.mesh.is_none();
    status.success() || is_without_mesh
}

/// The last error on standard error, else its last line, else how the process ended.
fn last_words(said: &str, status: ExitStatus) -> String {
    let is_error = |line: &&str| line.starts_with("error: ");
    said.lines().rfind(is_error).or(said.lines().last()).map_or_else(|| status.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variant(settings: &[&str]) -> Variant {
        let settings = settings.iter().map(ToString::to_string).collect();
        Variant { name: "grid".into(), method: "grid".into(), settings }
    }

    fn job<'a>(folder: &'a RunFolder, variant: &'a Variant, cancellation: &'a Cancellation) -> Job<'a> {
        let scene = Path::new("scene");
        let (supervision, downscale) = ("rgb", None);
        Job { scene, folder, variant, supervision, seed: 0, downscale, time: None, follow_shape: false, cancellation }
    }

    #[test]
    fn settings_are_complete_and_say_what_differs() {
        let (folder, token) = (RunFolder::new("runs/a"), Cancellation::default());
        let settings = |settings: &[&str], seed: u64| {
            let variant = variant(settings);
            Job { seed, ..job(&folder, &variant, &token) }.settings()
        };
        let first = settings(&[], 0).unwrap();
        assert!(first["method"]["config"]["losses"].is_object(), "defaults are there: {first}");
        let default = first["method"]["config"]["rays"].to_string();
        assert_eq!(settings(&[&format!("rays={default}")], 0).unwrap(), first, "a default that is given");
        let others = [settings(&["rays=99"], 0), settings(&["refine_cameras=3"], 0), settings(&[], 1)];
        for other in others {
            assert_ne!(other.unwrap(), first);
        }
        let quarter = Job { downscale: Some(2), ..job(&folder, &variant(&[]), &token) }.settings().unwrap();
        assert_ne!(quarter, first);
        let elsewhere = RunFolder::new("runs/b");
        assert_eq!(job(&elsewhere, &variant(&[]), &token).settings().unwrap(), first, "wherever it is written");
        let refused = settings(&["no_such=1"], 0).unwrap_err();
        assert!(format!("{refused:#}").contains("unknown key"), "{refused:#}");
    }

    /// A program that leaves figures and ends in some way.
    #[cfg(unix)]
    fn ended(mesh: Value, script: &str) -> Ended {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let run = RunFolder::new(folder.path().join("run"));
        std::fs::create_dir(run.root()).unwrap();
        let figures = json!({
            "scene": "ball", "supervision": "rgb", "seed": 0, "steps": 1, "model_step": 1, "parameters": 1, "bytes": 1,
            "training_seconds": 1.0, "model_seconds": 1.0, "mesh": mesh,
            "shape": { "surface": null, "floor": null, "volume_iou": null }, "test": null, "test_mesh": null,
            "validation": null, "views": { "train": [], "validation": [], "test": [], "rule": "" },
            "resources": { "cpu_seconds": 1.0, "peak_memory": null }, "warnings": [],
        });
        std::fs::write(folder.path().join("figures"), figures.to_string()).unwrap();
        // An earlier run's.
        std::fs::write(run.metrics_json(), figures.to_string()).unwrap();
        let (program, arguments) = (folder.path().join("program"), folder.path().join("arguments"));
        let (from, to) = (folder.path().join("figures"), run.metrics_json());
        let script = script.replace("WRITE", &format!("cp {} {}", from.display(), to.display()));
        std::fs::write(&program, format!("#!/bin/sh\necho \"$@\" > {}\n{script}\n", arguments.display())).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        let variant = variant(&[&format!("program={}", program.display()), "rays=99"]);
        let ended = job(&run, &variant, &Cancellation::default()).run().unwrap();
        let heard = std::fs::read_to_string(folder.path().join("arguments")).unwrap();
        assert!(heard.contains("--set rays=99") && !heard.contains("program="), "{heard}");
        ended
    }

    #[test]
    fn keys_name_another_program_and_tell_it_apart_by_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let (run, token) = (RunFolder::new("run"), Cancellation::default());
        let program = folder.path().join("dvr");
        let of_program = variant(&[&format!("program={}", program.display())]);
        let scene = || Digest::of_bytes(b"scene");
        let key = || job(&run, &of_program, &token).record_key(scene(), &json!({}));
        let missing = format!("{:#}", key().unwrap_err());
        assert!(missing.contains("program=") && missing.contains("dvr"), "{missing}");
        std::fs::write(&program, "one build").unwrap();
        let one = key().unwrap();
        let own = job(&run, &variant(&[]), &token).record_key(scene(), &json!({})).unwrap();
        assert!(one.program.starts_with(&own.program) && one.program.contains("trained by dvr (binary "), "{one:?}");
        std::fs::write(&program, "another").unwrap();
        assert_ne!(key().unwrap(), one);
    }

    #[cfg(unix)]
    #[test]
    fn a_child_that_fails_is_a_failure_whatever_figures_lie_there() {
        let failure = |mesh: Value, script: &str| match ended(mesh, script) {
            Ended::Failed { said, code } => (said, code),
            Ended::Measured { .. } => panic!("measured: {script}"),
        };
        let mesh = || json!([8, 12]);
        assert_eq!(failure(mesh(), "echo 'error: no' >&2; exit 2"), ("error: no".into(), Some(2)), "stale figures");
        assert_eq!(failure(mesh(), "WRITE; echo late >&2; exit 3"), ("late".into(), Some(3)));
        assert_eq!(failure(mesh(), "WRITE; exit 2").1, Some(2), "a mesh was made, and then something failed");
        assert_eq!(failure(Value::Null, "WRITE; kill -9 $$").1, None);
        assert_eq!(failure(mesh(), "exit 0").1, Some(0), "no figures");
        assert!(matches!(ended(mesh(), "WRITE; exit 0"), Ended::Measured { .. }));
        assert!(matches!(ended(Value::Null, "WRITE; exit 2"), Ended::Measured { .. }), "there is no surface");
    }
}
