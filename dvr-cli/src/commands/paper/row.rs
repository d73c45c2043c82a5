//! A row of the table of single pictures: its trainings, its figures and its meshes, by the commands that a user would give.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use dvr_core::Cancellation;
use dvr_core::record::{Digest, RecordKey};
use dvr_report::Curves;
use dvr_train::{ObjectsMetrics, RunFolder, Summary, merge_results, method_by_name};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::call::Caller;
use super::systems::{Maker, System};
use crate::args::PaperArgs;
use crate::commands::kept_row::{Kept, keep, kept};
use crate::commands::provenance::record_key;

/// Views of each object that its silhouettes are compared with.
const OBJECT_VIEWS: &str = "4";

/// Where and on what all rows are made.
pub struct Place<'a> {
    /// The dataset.
    pub data: &'a Path,
    /// Its digest.
    pub digest: &'a Digest,
    /// The folder of the table.
    pub out: &'a Path,
    /// Cells along an edge at which surfaces are measured.
    pub resolution: usize,
    /// Steps of each training, where they are not its own.
    pub steps: Option<usize>,
    /// The encoder of all trainings but those that need one of their own.
    pub encoder: Option<&'a str>,
    pub cancellation: &'a Cancellation,
}

impl<'a> Place<'a> {
    /// The place that the arguments give, for a dataset.
    pub fn new(args: &'a PaperArgs, data: &'a Path, digest: &'a Digest, cancellation: &'a Cancellation) -> Self {
        let PaperArgs { out, resolution, steps, encoder, .. } = args;
        let encoder = encoder.as_deref();
        Self { data, digest, out, resolution: *resolution, steps: *steps, encoder, cancellation }
    }
}

/// How a training went.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trained {
    /// Its steps.
    pub steps: usize,
    /// Wall seconds, all sessions.
    pub seconds: f64,
    /// CPU seconds with what goes before the first step, all sessions up to their last lines of `metrics.csv`.
    pub cpu_seconds: f64,
    /// Numbers of the model.
    pub parameters: usize,
}

/// What a row of one seed came to.
pub struct Made {
    /// How it was trained; `None` of a lookup.
    pub trained: Option<Trained>,
    /// Its figures.
    pub summary: Summary,
}

/// A row with a seed.
pub struct Row<'a> {
    pub system: &'static System,
    pub seed: u64,
    pub place: &'a Place<'a>,
}

impl Row<'_> {
    /// The name of its folders.
    pub fn name(&self) -> String {
        match self.system.maker {
            Maker::Baseline(_) => self.system.row.to_owned(),
            Maker::Training(..) | Maker::WithEncoder(..) => format!("{}.{}", self.system.row, self.seed),
        }
    }

    fn run(&self) -> RunFolder {
        RunFolder::new(self.place.out.join("runs").join(self.name()))
    }

    fn record(&self, ending: &str) -> PathBuf {
        self.place.out.join("runs").join(format!("{}.{ending}", self.name()))
    }

    /// The encoder of its training, where it is not the method's own.
    fn encoder(&self) -> Option<&str> {
        let (_, _, own) = self.system.maker.training()?;
        own.or(self.place.encoder)
    }

    /// Optimiser steps of its training.
    ///
    /// # Errors
    /// When its method has no configuration.
    pub fn steps(&self) -> Result<usize> {
        let Some((method, supervision, _)) = self.system.maker.training() else { return Ok(0) };
        let own = method_by_name(method, supervision)?.config()?["steps"].as_u64().unwrap_or(0);
        Ok(self.place.steps.unwrap_or(own as usize))
    }

    /// What its training is made of.
    fn key(&self) -> Result<RecordKey> {
        let Some((method, supervision, _)) = self.system.maker.training() else {
            return record_key(self.place.digest.clone(), &json!({}), "cpu");
        };
        let mut changes = json!({"seed": self.seed, "steps": self.steps()?});
        if let Some(kind) = self.encoder() {
            changes["encoder"] = json!({ "kind": kind });
        }
        let record = method_by_name(method, supervision)?.overridden(&changes)?.record()?;
        record_key(self.place.digest.clone(), &json!({ "method": record }), "cpu")
    }

    /// The training that is kept, if it has today's key.
    ///
    /// # Errors
    /// When its file is damaged.
    pub fn kept(&self) -> Result<Kept<Trained>> {
        kept(&self.record("json"), &self.key()?)
    }

    /// Trains and measures, where that is not done.
    ///
    /// # Errors
    /// What the commands said.
    pub fn make(&self, hear: &mut dyn FnMut(&str)) -> Result<Made> {
        let figures = self.place.out.join("eval").join(self.name());
        let mut arguments: Vec<OsString> = vec!["eval".into()];
        let trained = match self.system.maker {
            Maker::Training(..) | Maker::WithEncoder(..) => {
                let trained = self.train(hear)?;
                arguments.push(self.run().root().into());
                Some(trained)
            }
            Maker::Baseline(name) => {
                arguments.extend(["--baseline".into(), name.into(), "--data".into(), self.place.data.into()]);
                None
            }
        };
        self.forget_other_figures(&figures)?;
        let resolution = self.place.resolution.to_string();
        arguments
            .extend(["--split", "test", "--object-views", OBJECT_VIEWS, "--resolution", &resolution].map(Into::into));
        arguments.extend(["--out".into(), figures.clone().into()]);
        self.call(arguments, hear)?;
        let summaries = merge_results(&[figures.join("objects.jsonl")])?;
        let summary = summaries.into_iter().next().with_context(|| format!("{} is empty", figures.display()))?;
        Ok(Made { trained, summary })
    }

    /// Removes figures of another training, or of another resolution, which `dvr eval` would not mix with today's.
    fn forget_other_figures(&self, figures: &Path) -> Result<()> {
        let (record, key) = (self.record("figures.json"), self.key()?);
        let of = json!({"training": key.settings, "resolution": self.place.resolution});
        let key = RecordKey { settings: Digest::of_json(&of), ..key };
        if matches!(kept::<()>(&record, &key)?, Kept::Row(())) {
            return Ok(());
        }
        let file = figures.join("objects.jsonl");
        if file.exists() {
            std::fs::remove_file(&file).with_context(|| file.display().to_string())?;
        }
        std::fs::create_dir_all(self.place.out.join("runs"))?;
        keep(&record, &key, ())
    }

    /// The training, which goes on where it was stopped.
    fn train(&self, hear: &mut dyn FnMut(&str)) -> Result<Trained> {
        let (record, begun, key) = (self.record("json"), self.record("begun.json"), self.key()?);
        if let Kept::Row(trained) = kept(&record, &key)? {
            return Ok(trained);
        }
        let run = self.run();
        let Some((method, supervision, _)) = self.system.maker.training() else {
            bail!("{} is not trained", self.name())
        };
        let mut arguments: Vec<OsString> = vec!["train".into()];
        if run.last().is_file() && matches!(kept::<()>(&begun, &key)?, Kept::Row(())) {
            arguments.extend(["--resume".into(), "--out".into(), run.root().into()]);
        } else {
            std::fs::create_dir_all(self.place.out.join("runs"))?;
            keep(&begun, &key, ())?;
            arguments.extend([self.place.data.into(), "--out".into(), run.root().into(), "--overwrite".into()]);
            let (supervision, seed, steps) =
                (supervision.to_string(), self.seed.to_string(), self.steps()?.to_string());
            let own = ["--method", method, "--supervision", &supervision, "--seed", &seed, "--steps", &steps];
            arguments.extend(own.map(Into::into));
            arguments.extend(self.encoder().into_iter().flat_map(|kind| ["--encoder", kind]).map(Into::into));
        }
        arguments.push("--no-report".into());
        self.call(arguments, hear)?;
        let path = run.metrics_json();
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        let metrics: ObjectsMetrics = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        let ObjectsMetrics { steps, training_seconds: seconds, parameters, .. } = metrics;
        let cpu_seconds = cpu_seconds(&Curves::read(&run.metrics_csv())?);
        keep(&record, &key, Trained { steps, seconds, cpu_seconds, parameters })
    }

    /// Meshes of pictures, each with a preview, in a folder of the row.
    ///
    /// # Errors
    /// What the command said.
    pub fn predict(&self, pictures: &Path, hear: &mut dyn FnMut(&str)) -> Result<PathBuf> {
        let out = self.place.out.join("predictions").join(self.name());
        let resolution = self.place.resolution.to_string();
        let arguments: [OsString; 7] = [
            "predict".into(),
            self.run().root().into(),
            pictures.into(),
            "--out".into(),
            out.clone().into(),
            "--resolution".into(),
            resolution.into(),
        ];
        self.call(arguments.into(), hear)?;
        Ok(out)
    }

    fn call(&self, arguments: Vec<OsString>, hear: &mut dyn FnMut(&str)) -> Result<()> {
        Caller { name: &self.name(), cancellation: self.place.cancellation }.call(arguments, hear)
    }
}

/// CPU seconds of all sessions of a training; each counts its own from zero.
fn cpu_seconds(curves: &Curves) -> f64 {
    let counted = curves.pairs("step", "cpu_seconds");
    let ends_session = |i: usize| counted.get(i + 1).is_none_or(|next| next[1] < counted[i][1]);
    (0..counted.len()).filter(|&i| ends_session(i)).map(|i| counted[i][1]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cpu_seconds_are_those_of_all_sessions() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        std::fs::write(&path, "step,cpu_seconds\n10,3.5\n20,5\n30,2\n40,4.25\n").unwrap();
        assert_eq!(cpu_seconds(&Curves::read(&path).unwrap()), 9.25);
        assert_eq!(cpu_seconds(&Curves::default()), 0.0);
    }
}
