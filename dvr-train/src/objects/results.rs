//! What an evaluation found, object by object, in a file that grows: JSON lines, the first of which says what was
//! measured.
//!
//! A run that is killed loses the object it was at, and nothing else; shards of one evaluation are joined by their
//! lines.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use dvr_core::Split;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::evaluate::ShapeEvaluation;
use dvr_render::ViewMetrics;

/// Version of the files.
const VERSION: u32 = 1;

/// What was measured, and how: figures of files that agree in this may stand in one mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measurement {
    /// Format version.
    pub version: u32,
    /// What made the shapes: a run's name, or that of a baseline.
    pub predictor: String,
    /// Optimiser steps of the model; 0 for baselines.
    pub steps: usize,
    /// The split.
    pub split: Split,
    /// Seed of surface samples and of the choice of pictures.
    pub seed: u64,
    /// Cells of the extraction's grid along an edge of the cube.
    pub resolution: usize,
    /// Views of each object that its mesh was rendered from.
    pub views: usize,
}

impl Measurement {
    /// A measurement of this program.
    pub fn new(predictor: String, steps: usize, split: Split, seed: u64, resolution: usize, views: usize) -> Self {
        Self { version: VERSION, predictor, steps, split, seed, resolution, views }
    }
}

/// The figures of one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectScore {
    /// Folder of its category.
    pub category: String,
    /// What the category is called.
    pub category_name: String,
    /// Its folder.
    pub name: String,
    /// The number of the picture that its shape was made of.
    pub input: usize,
    /// The shape against the truth.
    pub shape: ShapeEvaluation,
    /// Renders of the coloured mesh against its views, where these were asked for.
    pub views: Option<ViewMetrics>,
}

/// A file of results.
pub struct Results {
    path: PathBuf,
    file: File,
    /// What was measured.
    pub measurement: Measurement,
    /// The figures so far.
    pub scores: Vec<ObjectScore>,
}

impl Results {
    /// Takes up the file at `path`, or starts it. A last line that was cut short is dropped.
    ///
    /// # Errors
    /// When the file cannot be read or written, or holds another measurement.
    pub fn open(path: &Path, measurement: Measurement) -> Result<Self> {
        let (mut scores, mut text) = (Vec::new(), line(path, &measurement)?);
        if path.exists() {
            let (earlier, found) = read_results(path)?;
            if earlier != measurement {
                let difference = difference(&earlier, &measurement);
                return Err(Error::OtherMeasurement { path: path.to_owned(), difference });
            }
            scores = found;
            // As it is, but for what was cut short.
            text = read_text(path)?;
            text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        }
        dvr_core::files::write_bytes_atomically(path, text.as_bytes())?;
        let file = OpenOptions::new().append(true).open(path).map_err(|e| dvr_core::Error::io(path, e))?;
        Ok(Self { path: path.to_owned(), file, measurement, scores })
    }

    /// Whether an object's figures are there.
    pub fn holds(&self, category: &str, name: &str) -> bool {
        self.scores.iter().any(|score| score.category == category && score.name == name)
    }

    /// Adds the figures of an object.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, score: ObjectScore) -> Result<()> {
        let line = line(&self.path, &score)?;
        self.file.write_all(line.as_bytes()).map_err(|e| dvr_core::Error::io(&self.path, e))?;
        // As a later run will read it: to the last digit the same means, however often the work was stopped.
        self.scores.push(parse(&self.path, self.scores.len() + 1, &line)?);
        Ok(())
    }
}

/// Reads a file of results; a last line that was cut short is left out.
///
/// # Errors
/// When the file cannot be read, or is none.
pub fn read_results(path: &Path) -> Result<(Measurement, Vec<ObjectScore>)> {
    let text = read_text(path)?;
    let mut lines = text.split_inclusive('\n').enumerate();
    let (number, first) = lines.next().unwrap_or((0, ""));
    let measurement: Measurement = parse(path, number, first)?;
    if measurement.version != VERSION {
        let problem = format!("results of version {}; this program reads version {VERSION}", measurement.version);
        return Err(refuse(path, problem));
    }
    let whole = lines.filter(|(_, line)| line.ends_with('\n'));
    let scores = whole.map(|(number, line)| parse(path, number, line));
    Ok((measurement, scores.collect::<Result<_>>()?))
}

fn read_text(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).map_err(|e| dvr_core::Error::io(path, e).into())
}

/// What a line, counted from 0, says.
fn parse<T: for<'de> Deserialize<'de>>(path: &Path, number: usize, line: &str) -> Result<T> {
    serde_json::from_str(line).map_err(|e| {
        let problem = format!("line {} is no result ({e})", number + 1);
        refuse(path, problem)
    })
}

/// In what two measurements differ.
fn difference(a: &Measurement, b: &Measurement) -> String {
    let value = |measurement| serde_json::to_value(measurement).unwrap_or_default();
    let (a, b) = (value(a), value(b));
    let fields = a.as_object().into_iter().flatten();
    let differing = fields.filter(|(key, value)| b.get(key) != Some(value));
    differing.map(|(key, value)| format!("{key} {value}")).collect::<Vec<_>>().join(", ")
}

fn line(path: &Path, value: &impl Serialize) -> Result<String> {
    let json = serde_json::to_string(value);
    json.map(|json| json + "\n").map_err(|e| refuse(path, format!("cannot be written ({e})")))
}

fn refuse(path: &Path, problem: String) -> Error {
    Error::BrokenFile { path: path.to_owned(), problem }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measurement() -> Measurement {
        Measurement::new("run".into(), 3, Split::Test, 0, 64, 0)
    }

    fn score(name: &str) -> ObjectScore {
        let shape = ShapeEvaluation { surface: None, floor: None, volume_iou: Some(0.5) };
        let category = || "chair".to_owned();
        ObjectScore { category: category(), category_name: category(), name: name.into(), input: 1, shape, views: None }
    }

    #[test]
    fn what_was_written_is_taken_up_and_half_a_line_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("objects.jsonl");
        let mut results = Results::open(&path, measurement()).unwrap();
        results.add(score("a")).unwrap();
        results.add(score("b")).unwrap();
        drop(results);
        let bytes = std::fs::read(&path).unwrap();
        for cut in 1..20 {
            std::fs::write(&path, &bytes[..bytes.len() - cut]).unwrap();
            let results = Results::open(&path, measurement()).unwrap();
            assert!(results.holds("chair", "a") && !results.holds("chair", "b") && !results.holds("sofa", "a"));
            assert_eq!(read_results(&path).unwrap().1.len(), 1, "the rest of the line is gone");
        }
    }

    #[test]
    fn figures_of_another_measurement_are_not_mixed_in() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("objects.jsonl");
        Results::open(&path, measurement()).unwrap();
        let other = Measurement { resolution: 128, ..measurement() };
        let message = Results::open(&path, other).err().unwrap().to_string();
        assert!(message.contains("resolution 64"), "{message}");
        std::fs::write(&path, "{\"no\": \"measurement\"}\n").unwrap();
        assert!(Results::open(&path, measurement()).err().unwrap().to_string().contains("line 1"));
    }
}
