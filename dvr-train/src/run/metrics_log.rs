//! The curves of a run: `metrics.csv`, one row every few steps.

use std::collections::HashMap;
use std::path::Path;

use dvr_render::ViewMetrics;

use crate::error::{Error, Result};
use crate::learners::step_report::StepReport;

/// The columns before those of the loss terms.
const BEFORE: [&str; 6] = ["step", "seconds", "loss", "mask_iou", "learning_rate", "samples"];

/// The columns after them.
const AFTER: [&str; 4] = ["validation_psnr", "validation_mask_iou", "cpu_seconds", "chamfer_l1"];

/// Whether a column of `metrics.csv` holds a loss term: all do but those that every run has.
pub fn is_loss_term(column: &str) -> bool {
    !BEFORE.contains(&column) && !AFTER.contains(&column)
}

/// Rows of `metrics.csv`, kept in memory and written whole: a run killed at any moment leaves a complete file.
///
/// The loss terms have columns in the order in which they first appear.
#[derive(Clone, Debug, Default)]
pub(crate) struct MetricsLog {
    terms: Vec<String>,
    rows: Vec<Row>,
}

/// One row: the cells before the terms, one for each term that was known then, and the cells after.
#[derive(Clone, Debug)]
struct Row {
    before: Vec<String>,
    terms: Vec<String>,
    after: Vec<String>,
}

impl MetricsLog {
    /// Reads the rows up to `last_step` of an interrupted run, so that a resumed one goes on behind its checkpoint.
    ///
    /// # Errors
    /// When the file is there but is no CSV.
    pub fn resume(path: &Path, last_step: usize) -> Result<Self> {
        if !path.exists() {
            return Ok(Self::default());
        }
        let broken = |e: csv::Error| Error::BrokenFile { path: path.to_owned(), problem: e.to_string() };
        let mut reader = csv::Reader::from_path(path).map_err(broken)?;
        let names: Vec<String> = reader.headers().map_err(broken)?.iter().map(str::to_owned).collect();
        let mut places = HashMap::new();
        for (place, name) in names.iter().enumerate() {
            places.entry(name.as_str()).or_insert(place);
        }
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(broken)?;
            let cell =
                |name: &str| places.get(name).and_then(|place| record.get(*place)).unwrap_or_default().to_owned();
            if cell("step").parse::<usize>().is_ok_and(|step| step <= last_step) {
                let cells = |columns: &[&str]| columns.iter().map(|name| cell(name)).collect();
                let terms = names.iter().filter(|name| is_loss_term(name)).map(|name| cell(name)).collect();
                rows.push(Row { before: cells(&BEFORE), terms, after: cells(&AFTER) });
            }
        }
        Ok(Self { terms: names.into_iter().filter(|name| is_loss_term(name)).collect(), rows })
    }

    /// Adds a row: what a step did after so many wall seconds of training and CPU seconds of this process, what a
    /// validation after it said, and how far the shape was from the truth.
    pub fn push(
        &mut self,
        report: &StepReport,
        [seconds, cpu_seconds]: [f64; 2],
        validation: Option<&ViewMetrics>,
        chamfer_l1: Option<f64>,
    ) {
        for (name, _) in &report.terms {
            if !self.terms.iter().any(|known| known == name) {
                self.terms.push((*name).to_owned());
            }
        }
        let term = |name: &String| {
            let of_name = || report.terms.iter().filter(|(other, _)| other == name).map(|(_, value)| value);
            of_name().next().map_or(String::new(), |_| format!("{:.6}", of_name().sum::<f64>()))
        };
        self.rows.push(Row {
            before: vec![
                report.step.to_string(),
                format!("{seconds:.3}"),
                format!("{:.6}", report.loss),
                known(report.mask_iou),
                format!("{:e}", report.learning_rate),
                report.samples.to_string(),
            ],
            terms: self.terms.iter().map(term).collect(),
            after: vec![
                validation.map_or(String::new(), |v| format!("{:.3}", v.psnr)),
                validation.map_or(String::new(), |v| format!("{:.4}", v.mask_iou)),
                format!("{cpu_seconds:.3}"),
                chamfer_l1.map_or(String::new(), |distance| format!("{distance:.6}")),
            ],
        });
    }

    /// Writes the file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let names: Vec<&str> = BEFORE.into_iter().chain(self.terms.iter().map(String::as_str)).chain(AFTER).collect();
        let mut text = names.join(",");
        text.push('\n');
        for Row { before, terms, after } in &self.rows {
            let missing = vec![String::new(); self.terms.len() - terms.len()];
            text.push_str(&[before.as_slice(), terms, &missing, after].concat().join(","));
            text.push('\n');
        }
        Ok(dvr_core::files::write_bytes_atomically(path, text.as_bytes())?)
    }
}

/// A figure, or nothing where there is none.
fn known(figure: f64) -> String {
    if figure.is_nan() { String::new() } else { format!("{figure:.4}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_term_gets_a_column_and_old_rows_stay_aligned() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let report = |step, terms| StepReport { step, loss: 1.0, terms, mask_iou: 0.5, learning_rate: 0.1, samples: 8 };
        let mut log = MetricsLog::default();
        log.push(&report(10, vec![("color", 0.25)]), [1.0, 2.0], None, None);
        log.push(&report(20, vec![("shininess", 0.5), ("color", 0.5)]), [2.0, 4.0], None, Some(0.125));
        log.save(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].contains(",samples,color,shininess,validation_psnr,"), "{text}");
        assert_eq!(lines[1], "10,1.000,1.000000,0.5000,1e-1,8,0.250000,,,,2.000,");
        assert_eq!(lines[2], "20,2.000,1.000000,0.5000,1e-1,8,0.500000,0.500000,,,4.000,0.125000");
        let resumed = MetricsLog::resume(&path, 20).unwrap();
        resumed.save(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), text);
        assert_eq!(MetricsLog::resume(&path, 10).unwrap().rows.len(), 1);
    }
}
