//! Means over categories and objects, as tables: JSON, CSV and Markdown.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::results::{Measurement, ObjectScore, StoredResults, Unmeasured, read_results};
use crate::error::{Error, Result};

/// The figures that have a column: name, unit or scale for people, decimals, and where they are found.
type Figure = (&'static str, &'static str, usize, fn(&ObjectScore) -> Option<f64>);

/// Lengths are in edges of the object cube; the tables for people print Chamfer-L1 times ten, as papers do.
const FIGURES: [Figure; 11] = [
    ("chamfer_l1", "Chamfer-L1", 4, |score| Some(score.shape.surface.as_ref()?.chamfer_l1)),
    ("chamfer_l1_floor", "Chamfer-L1, floor", 4, |score| Some(score.shape.floor.as_ref()?.chamfer_l1)),
    ("accuracy", "accuracy", 4, |score| Some(score.shape.surface.as_ref()?.accuracy)),
    ("completeness", "completeness", 4, |score| Some(score.shape.surface.as_ref()?.completeness)),
    ("normal_consistency", "normal consistency", 3, |score| {
        Some(score.shape.surface.as_ref()?.normal_consistency?.mean)
    }),
    ("f_score_0.005", "F-score at .005", 3, |score| f_score(score, 0)),
    ("f_score_0.01", "F-score at .01", 3, |score| f_score(score, 1)),
    ("f_score_0.02", "F-score at .02", 3, |score| f_score(score, 2)),
    ("volume_iou", "volume IoU", 3, |score| score.shape.volume_iou),
    ("silhouette_iou", "silhouette IoU", 3, |score| Some(score.views?.mask_iou)),
    ("psnr", "PSNR dB", 2, |score| score.has_colors.then_some(score.views?.psnr)),
];

/// The figures that the Markdown tables show.
const SHOWN: [&str; 7] =
    ["chamfer_l1", "chamfer_l1_floor", "normal_consistency", "f_score_0.01", "volume_iou", "silhouette_iou", "psnr"];

/// The mean figures of one predictor over some objects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanScore {
    /// How many objects were measured.
    pub objects: usize,
    /// How many could not be.
    pub unmeasured: usize,
    /// Mean of each figure over the objects that have it.
    pub figures: BTreeMap<String, f64>,
}

/// One predictor's figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// What was measured.
    pub measurement: Measurement,
    /// By the category's name.
    pub categories: BTreeMap<String, MeanScore>,
    /// The mean of the categories' means, as papers print it.
    pub mean_of_categories: MeanScore,
    /// The mean over all objects.
    pub mean_of_objects: MeanScore,
    /// Where the figures come from: each machine with its program once.
    pub origins: BTreeSet<String>,
}

fn f_score(score: &ObjectScore, threshold: usize) -> Option<f64> {
    Some(score.shape.surface.as_ref()?.f_scores.get(threshold)?.f_score)
}

fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let values: Vec<f64> = values.flatten().collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The means over some objects, in their order.
fn mean_score(scores: &[&ObjectScore], unmeasured: usize) -> MeanScore {
    let of = |figure: &Figure| Some((figure.0.to_owned(), mean(scores.iter().map(|score| figure.3(score)))?));
    MeanScore { objects: scores.len(), unmeasured, figures: FIGURES.iter().filter_map(of).collect() }
}

impl Summary {
    /// The means of one predictor's results, whatever their order.
    pub fn new(measurement: Measurement, scores: &[ObjectScore], unmeasured: &[Unmeasured]) -> Self {
        let mut sorted: Vec<&ObjectScore> = scores.iter().collect();
        sorted.sort_by(|a, b| (&a.category, &a.name).cmp(&(&b.category, &b.name)));
        let mut by_category: BTreeMap<String, Vec<&ObjectScore>> = BTreeMap::new();
        for score in &sorted {
            by_category.entry(score.category_name.clone()).or_default().push(score);
        }
        for object in unmeasured {
            by_category.entry(object.category_name.clone()).or_default();
        }
        let lost = |name: &str| unmeasured.iter().filter(|object| object.category_name == name).count();
        let category = |(name, scores): (String, Vec<&ObjectScore>)| {
            let score = mean_score(&scores, lost(&name));
            (name, score)
        };
        let categories: BTreeMap<String, MeanScore> = by_category.into_iter().map(category).collect();
        let of = |figure: &Figure| {
            let means = categories.values().map(|category| category.figures.get(figure.0).copied());
            Some((figure.0.to_owned(), mean(means)?))
        };
        let figures = FIGURES.iter().filter_map(of).collect();
        let mean_of_categories = MeanScore { objects: sorted.len(), unmeasured: unmeasured.len(), figures };
        let origins = sorted.iter().map(|score| format!("{}, {}", score.key.machine, score.key.program)).collect();
        Self {
            measurement,
            categories,
            mean_of_categories,
            mean_of_objects: mean_score(&sorted, unmeasured.len()),
            origins,
        }
    }

    /// The rows of a table: the categories and the two means.
    fn rows(&self) -> impl Iterator<Item = (&str, &MeanScore)> {
        let categories = self.categories.iter().map(|(name, score)| (name.as_str(), score));
        categories.chain([("mean of categories", &self.mean_of_categories), ("mean of objects", &self.mean_of_objects)])
    }
}

/// Reads files of results, joins the shards of each measurement, and sums them up, predictor by predictor.
///
/// # Errors
/// When a file is no results', an object is there twice, or the parts of one measurement were made with other settings
/// or by another program: they have no common mean.
pub fn merge_results(files: &[std::path::PathBuf]) -> Result<Vec<Summary>> {
    let mut joined: Vec<StoredResults> = Vec::new();
    for file in files {
        let StoredResults { measurement, scores, unmeasured } = read_results(file)?;
        let place = joined.iter().position(|other| other.measurement == measurement).unwrap_or_else(|| {
            joined.push(StoredResults { measurement, scores: Vec::new(), unmeasured: Vec::new() });
            joined.len() - 1
        });
        joined[place].unmeasured.extend(unmeasured);
        let known = &mut joined[place].scores;
        if let Some(twice) = scores.iter().find(|a| known.iter().any(|b| a.category == b.category && a.name == b.name))
        {
            let problem = format!("the figures of {}/{} are in an earlier file too", twice.category, twice.name);
            return Err(Error::BrokenFile { path: file.clone(), problem });
        }
        let made_by = |score: &ObjectScore| (score.key.settings.clone(), score.key.program.clone());
        if let (Some(first), Some(other)) = (known.first(), scores.first())
            && made_by(first) != made_by(other)
        {
            let problem = format!(
                "its rows are of {} and settings {}, those of earlier files of {} and settings {}",
                other.key.program, other.key.settings, first.key.program, first.key.settings
            );
            return Err(Error::BrokenFile { path: file.clone(), problem });
        }
        known.extend(scores);
    }
    Ok(joined.into_iter().map(|part| Summary::new(part.measurement, &part.scores, &part.unmeasured)).collect())
}

/// Writes `summary.json`, `summary.csv` and `summary.md` into a folder.
///
/// # Errors
/// When a file cannot be written.
pub fn write_summaries(folder: &Path, summaries: &[Summary]) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| dvr_core::Error::io(folder, e))?;
    let json = serde_json::to_string_pretty(summaries).map_err(|e| Error::NotStored { problem: e.to_string() })?;
    let files = [("summary.json", json), ("summary.csv", to_csv(summaries)?), ("summary.md", to_markdown(summaries))];
    for (name, text) in files {
        dvr_core::files::write_bytes_atomically(&folder.join(name), text.as_bytes())?;
    }
    Ok(())
}

/// A row for each predictor and category, a column for each figure, full precision, lengths in edges of the object cube.
fn to_csv(summaries: &[Summary]) -> Result<String> {
    let broken = |e: String| Error::NotStored { problem: e };
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header =
        ["predictor", "category", "objects", "unmeasured"].into_iter().chain(FIGURES.iter().map(|figure| figure.0));
    writer.write_record(header).map_err(|e| broken(e.to_string()))?;
    for summary in summaries {
        for (category, score) in summary.rows() {
            let figures = FIGURES.iter().map(|(key, ..)| score.figures.get(*key).map_or(String::new(), f64::to_string));
            let [objects, unmeasured] = [score.objects, score.unmeasured].map(|count| count.to_string());
            let start = [summary.measurement.predictor.clone(), category.to_owned(), objects, unmeasured];
            writer.write_record(start.into_iter().chain(figures)).map_err(|e| broken(e.to_string()))?;
        }
    }
    let bytes = writer.into_inner().map_err(|e| broken(e.to_string()))?;
    String::from_utf8(bytes).map_err(|e| broken(e.to_string()))
}

/// The papers' form: a row a category; a column a figure for one predictor, or a table a figure with a column a predictor.
pub fn to_markdown(summaries: &[Summary]) -> String {
    let mut text = String::new();
    let shown: Vec<&Figure> = FIGURES
        .iter()
        .filter(|figure| SHOWN.contains(&figure.0))
        .filter(|figure| summaries.iter().any(|summary| summary.mean_of_objects.figures.contains_key(figure.0)))
        .collect();
    if let [summary] = summaries {
        let titles: Vec<String> = shown.iter().map(|figure| title(figure)).collect();
        let _ = writeln!(text, "{}: {} objects\n", summary.measurement.predictor, count(&summary.mean_of_objects));
        let _ = writeln!(text, "{}.\n", origins(summaries));
        let _ = writeln!(text, "| category | objects | {} |", titles.join(" | "));
        let _ = writeln!(text, "|---|{}", "---|".repeat(1 + shown.len()));
        for (category, score) in summary.rows() {
            let cells: Vec<String> = shown.iter().map(|figure| cell(score, figure)).collect();
            let _ = writeln!(text, "| {category} | {} | {} |", count(score), cells.join(" | "));
        }
        return text;
    }
    let Some(first) = summaries.first() else { return text };
    let _ = writeln!(text, "{}.\n", origins(summaries));
    for figure in shown {
        let predictors: Vec<&str> = summaries.iter().map(|summary| summary.measurement.predictor.as_str()).collect();
        let _ = writeln!(text, "{}\n\n| category | objects | {} |", title(figure), predictors.join(" | "));
        let _ = writeln!(text, "|---|{}", "---|".repeat(1 + predictors.len()));
        for (category, score) in first.rows() {
            let of =
                |summary: &Summary| summary.rows().find(|(name, _)| *name == category).map(|(_, s)| cell(s, figure));
            let cells: Vec<String> = summaries.iter().map(|summary| of(summary).unwrap_or_default()).collect();
            let _ = writeln!(text, "| {category} | {} | {} |", count(score), cells.join(" | "));
        }
        text.push('\n');
    }
    text
}

/// How many objects were measured; of how many, where some could not be.
fn count(score: &MeanScore) -> String {
    match score.unmeasured {
        0 => score.objects.to_string(),
        lost => format!("{} of {}", score.objects, score.objects + lost),
    }
}

/// Where the figures of all come from.
fn origins(summaries: &[Summary]) -> String {
    let all: BTreeSet<&str> = summaries.iter().flat_map(|summary| &summary.origins).map(String::as_str).collect();
    all.into_iter().collect::<Vec<_>>().join("; ")
}

fn title((key, name, ..): &Figure) -> String {
    if key.starts_with("chamfer") { format!("{name} (x10)") } else { (*name).to_owned() }
}

fn cell(score: &MeanScore, (key, _, decimals, _): &Figure) -> String {
    let scale = if key.starts_with("chamfer") { 10.0 } else { 1.0 };
    score.figures.get(*key).map_or(String::new(), |value| format!("{:.decimals$}", scale * value))
}

#[cfg(test)]
mod tests {
    use dvr_core::Split;

    use super::*;
    use crate::evaluate::ShapeEvaluation;
    use crate::objects::results::Results;
    use crate::objects::results::tests::key;

    fn score(category: &str, name: &str, iou: f64) -> ObjectScore {
        let shape = ShapeEvaluation { volume_iou: Some(iou), ..ShapeEvaluation::default() };
        let [category, name] = [category, name].map(str::to_owned);
        let key = key("dvr 1");
        ObjectScore {
            category: category.clone(),
            category_name: category,
            name,
            input: 0,
            shape,
            views: None,
            has_colors: true,
            is_shape_kept: false,
            key,
        }
    }

    fn measurement(predictor: &str) -> Measurement {
        Measurement::new(predictor.into(), 0, Split::Test, 0, 64, 0)
    }

    #[test]
    fn every_category_counts_the_same_in_their_mean_and_every_object_in_the_other() {
        let scores = [score("bed", "a", 0.2), score("bed", "b", 0.4), score("car", "c", 0.9)];
        let summary = Summary::new(measurement("run"), &scores, &[]);
        let near = |score: &MeanScore, value: f64| (score.figures["volume_iou"] - value).abs() < 1e-12;
        assert!(near(&summary.categories["bed"], 0.3) && near(&summary.mean_of_categories, 0.6));
        assert!(near(&summary.mean_of_objects, 0.5));
        let mut turned = scores.to_vec();
        turned.reverse();
        assert_eq!(Summary::new(measurement("run"), &turned, &[]), summary, "whatever the order");
        let table = to_markdown(std::slice::from_ref(&summary));
        assert!(
            table.contains("| category | objects | volume IoU |") && table.contains("| bed | 2 | 0.300 |"),
            "{table}"
        );
        let two = to_markdown(&[summary.clone(), Summary::new(measurement("other"), &scores[..2], &[])]);
        assert!(
            two.contains("| category | objects | run | other |") && two.contains("| car | 1 | 0.900 |  |"),
            "{two}"
        );
        let csv = to_csv(&[summary]).unwrap();
        assert_eq!(csv.lines().count(), 5);
        assert!(csv.contains("run,car,1,0,,,,,,,,,0.9,,"), "{csv}");
        let [category, category_name, name, problem] = ["sofa", "sofa", "d", "broken"].map(str::to_owned);
        let lost = Unmeasured { category, category_name, name, problem };
        let table = to_markdown(&[Summary::new(measurement("run"), &scores, &[lost])]);
        assert!(table.contains("run: 3 of 4 objects") && table.contains("| sofa | 0 of 1 |  |"), "{table}");
        assert!(table.contains("| mean of categories | 3 of 4 | 0.600 |"), "{table}");
    }

    #[test]
    fn parts_of_different_programs_have_no_common_mean() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, object: &str, program: &str| {
            let path = folder.path().join(name);
            let mut results = Results::open(&path, measurement("run")).unwrap();
            results.add(ObjectScore { key: key(program), ..score("bed", object, 0.5) }).unwrap();
            path
        };
        let (one, two) = (file("1.jsonl", "a", "dvr 1"), file("2.jsonl", "b", "dvr 2"));
        let error = merge_results(&[one.clone(), two]).unwrap_err().to_string();
        assert!(error.contains("2.jsonl") && error.contains("dvr 1") && error.contains("dvr 2"), "{error}");
        let same = file("3.jsonl", "b", "dvr 1");
        let joined = merge_results(&[one, same]).unwrap();
        assert_eq!((joined.len(), joined[0].mean_of_objects.objects), (1, 2));
        assert!(to_markdown(&joined).contains("dvr 1."));
    }
}
