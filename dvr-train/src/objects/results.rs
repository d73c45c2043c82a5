//! What an evaluation found, object by object, in a file that grows: JSON lines, the first of which says what was
//! measured.
//!
//! A run that is killed loses the object it was at, and nothing else; shards of one evaluation are joined by their
//! lines.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use dvr_core::Split;
use dvr_core::record::RecordKey;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::evaluate::ShapeEvaluation;
use dvr_render::ViewMetrics;

/// Version of the files.
const VERSION: u32 = 2;

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
    /// Renders of the mesh against its views, where these were asked for.
    pub views: Option<ViewMetrics>,
    /// Whether the mesh has colours, without which the PSNR of its renders says nothing.
    #[serde(default = "yes")]
    pub has_colors: bool,
    /// Whether the shape was kept when it was measured.
    #[serde(default)]
    pub is_shape_kept: bool,
    /// What the figures were made of.
    pub key: RecordKey,
}

/// Earlier files hold coloured meshes alone.
fn yes() -> bool {
    true
}

/// An object that could not be measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Unmeasured {
    /// Folder of its category.
    pub category: String,
    /// What the category is called.
    pub category_name: String,
    /// Its folder.
    pub name: String,
    /// Why.
    pub problem: String,
}

/// A line of the file after the first.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Row {
    Score(Box<ObjectScore>),
    Unmeasured(Unmeasured),
}

/// What a file of results holds.
#[derive(Clone, Debug)]
pub struct StoredResults {
    /// What was measured.
    pub measurement: Measurement,
    /// The figures.
    pub scores: Vec<ObjectScore>,
    /// The objects that have none.
    pub unmeasured: Vec<Unmeasured>,
}

/// A file of results.
pub struct Results {
    path: PathBuf,
    file: File,
    /// What was measured.
    pub measurement: Measurement,
    /// The figures so far.
    pub scores: Vec<ObjectScore>,
    /// The objects that have none.
    pub unmeasured: Vec<Unmeasured>,
}

impl Results {
    /// Takes up the file at `path`, or starts it. A last line that was cut short is dropped, and so are objects that
    /// could not be measured: they are tried again.
    ///
    /// # Errors
    /// When the file cannot be read or written, or holds another measurement.
    pub fn open(path: &Path, measurement: Measurement) -> Result<Self> {
        let mut scores = Vec::new();
        if path.exists() {
            let (earlier, found) = read_rows(path)?;
            if earlier != measurement {
                let difference = difference(&earlier, &measurement);
                return Err(Error::OtherMeasurement { path: path.to_owned(), difference });
            }
            scores.extend(found.into_iter().filter_map(|row| match row {
                Row::Score(score) => Some(*score),
                Row::Unmeasured(_) => None,
            }));
        }
        let file = rewritten(path, &measurement, &scores)?;
        Ok(Self { path: path.to_owned(), file, measurement, scores, unmeasured: Vec::new() })
    }

    /// Keeps the figures that are `current` and drops all others, here and in the file; returns how many were dropped.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn keep(&mut self, current: impl Fn(&ObjectScore) -> bool) -> Result<usize> {
        let before = self.scores.len();
        self.scores.retain(current);
        let dropped = before - self.scores.len();
        if dropped > 0 {
            self.file = rewritten(&self.path, &self.measurement, &self.scores)?;
        }
        Ok(dropped)
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
        // As a later run will read it: JSON has no infinity.
        self.scores.push(parse(&self.path, self.scores.len() + 1, &line)?);
        Ok(())
    }

    /// Adds an object that could not be measured.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add_unmeasured(&mut self, object: Unmeasured) -> Result<()> {
        let line = line(&self.path, &object)?;
        self.file.write_all(line.as_bytes()).map_err(|e| dvr_core::Error::io(&self.path, e))?;
        self.unmeasured.push(object);
        Ok(())
    }
}

/// Reads a file of results; a last line that was cut short is left out.
///
/// # Errors
/// When the file cannot be read, or is none.
pub fn read_results(path: &Path) -> Result<StoredResults> {
    let (measurement, rows) = read_rows(path)?;
    let mut stored = StoredResults { measurement, scores: Vec::new(), unmeasured: Vec::new() };
    for row in rows {
        match row {
            Row::Score(score) => stored.scores.push(*score),
            Row::Unmeasured(object) => stored.unmeasured.push(object),
        }
    }
    Ok(stored)
}

/// The rows of a file.
fn read_rows(path: &Path) -> Result<(Measurement, Vec<Row>)> {
    let text = dvr_core::files::read_text(path)?;
    let mut lines = text.split_inclusive('\n').enumerate();
    let (number, first) = lines.next().unwrap_or((0, ""));
    let measurement: Measurement = parse(path, number, first)?;
    if measurement.version != VERSION {
        let problem = format!("results of version {}; this program reads version {VERSION}", measurement.version);
        return Err(refuse(path, problem));
    }
    let whole = lines.filter(|(_, line)| line.ends_with('\n'));
    let rows = whole.map(|(number, line)| parse(path, number, line));
    Ok((measurement, rows.collect::<Result<_>>()?))
}

/// Writes the file with these figures, and opens it to add more.
fn rewritten(path: &Path, measurement: &Measurement, scores: &[ObjectScore]) -> Result<File> {
    let lines: Vec<String> = scores.iter().map(|score| line(path, score)).collect::<Result<_>>()?;
    let text = line(path, measurement)? + &lines.concat();
    dvr_core::files::write_bytes_atomically(path, text.as_bytes())?;
    Ok(OpenOptions::new().append(true).open(path).map_err(|e| dvr_core::Error::io(path, e))?)
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
pub(crate) mod tests {
    use dvr_core::record::{Digest, Machine};
    use serde_json::json;

    use super::*;

    /// A key of the program of that name.
    pub fn key(program: &str) -> RecordKey {
        let machine = Machine { cpu: "a CPU".into(), cores: 2, threads: 2, device: "cpu".into() };
        let digest = Digest::of_json(&json!(null));
        RecordKey { scene: digest.clone(), settings: digest, program: program.into(), machine }
    }

    fn measurement() -> Measurement {
        Measurement::new("run".into(), 3, Split::Test, 0, 64, 0)
    }

    fn score(name: &str) -> ObjectScore {
        let shape = ShapeEvaluation { volume_iou: Some(0.5), ..ShapeEvaluation::default() };
        let category = || "chair".to_owned();
        ObjectScore {
            category: category(),
            category_name: category(),
            name: name.into(),
            input: 1,
            shape,
            has_colors: true,
            is_shape_kept: false,
            views: None,
            key: key("dvr 1"),
        }
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
            assert_eq!(read_results(&path).unwrap().scores.len(), 1, "the rest of the line is gone");
        }
    }

    #[test]
    fn rows_of_another_key_leave_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("objects.jsonl");
        let mut results = Results::open(&path, measurement()).unwrap();
        results.add(score("a")).unwrap();
        results.add(ObjectScore { key: key("dvr 2"), ..score("b") }).unwrap();
        let current = key("dvr 2");
        assert_eq!(results.keep(|score| score.key == current).unwrap(), 1);
        assert!(!results.holds("chair", "a") && results.holds("chair", "b"));
        results.add(ObjectScore { key: key("dvr 2"), ..score("a") }).unwrap();
        let stored = read_results(&path).unwrap();
        let rows: Vec<_> =
            stored.scores.iter().map(|score| (score.name.as_str(), score.key.program.as_str())).collect();
        assert_eq!(rows, [("b", "dvr 2"), ("a", "dvr 2")]);
        assert_eq!(results.keep(|_| true).unwrap(), 0);
    }

    #[test]
    fn objects_that_could_not_be_measured_are_counted_and_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("objects.jsonl");
        let mut results = Results::open(&path, measurement()).unwrap();
        results.add(score("a")).unwrap();
        let [category, category_name, name, problem] = ["chair", "chair", "b", "no cameras"].map(str::to_owned);
        results.add_unmeasured(Unmeasured { category, category_name, name, problem }).unwrap();
        let stored = read_results(&path).unwrap();
        assert_eq!((stored.scores.len(), stored.unmeasured.len()), (1, 1));
        let again = Results::open(&path, measurement()).unwrap();
        assert!(again.holds("chair", "a") && !again.holds("chair", "b"));
        assert!(read_results(&path).unwrap().unmeasured.is_empty());
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
