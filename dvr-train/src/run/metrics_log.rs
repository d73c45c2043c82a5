//! The curves of a run: `metrics.csv`, one row every few steps.

use std::path::Path;

use crate::error::{Error, Result};
use crate::learners::trainer::StepReport;
use dvr_render::ViewMetrics;

/// The loss terms that have a column, in order.
const TERMS: [&str; 14] = [
    "color",
    "photo_consistency",
    "structure",
    "mask",
    "smoothness",
    "texture",
    "image_gradient",
    "depth",
    "sparse_depth",
    "free_space",
    "free_space_missed",
    "free_space_entry",
    "occupancy",
    "normal",
];

/// Names of the columns.
fn header() -> Vec<&'static str> {
    let mut header = vec!["step", "seconds", "loss", "mask_iou", "learning_rate", "samples"];
    header.extend(TERMS);
    header.extend(["held_out_psnr", "held_out_mask_iou", "cpu_seconds", "chamfer_l1"]);
    header
}

/// Rows of `metrics.csv`, kept in memory and written whole: a run killed at any moment leaves a complete file.
#[derive(Clone, Debug, Default)]
pub struct MetricsLog {
    rows: Vec<Vec<String>>,
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
        let broken = |e: csv::Error| Error::Run {
            path: path.to_owned(),
            problem: format!("the file cannot be read ({e})"),
            remedy: "Move it away and resume again.".into(),
        };
        let mut reader = csv::Reader::from_path(path).map_err(broken)?;
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(broken)?;
            if record.get(0).and_then(|step| step.parse::<usize>().ok()).is_some_and(|step| step <= last_step) {
                // An earlier version of the program wrote fewer columns.
                let mut row: Vec<String> = record.iter().map(str::to_owned).collect();
                row.resize(row.len().max(header().len()), String::new());
                rows.push(row);
            }
        }
        Ok(Self { rows })
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
        let term = |name: &str| {
            let sum: f64 = report.terms.iter().filter(|(n, _)| *n == name).map(|(_, value)| value).sum();
            if report.terms.iter().any(|(n, _)| *n == name) { format!("{sum:.6}") } else { String::new() }
        };
        let mut row = vec![
            report.step.to_string(),
            format!("{seconds:.3}"),
            format!("{:.6}", report.loss),
            format!("{:.4}", report.mask_iou),
            format!("{:e}", report.learning_rate),
            report.samples.to_string(),
        ];
        row.extend(TERMS.iter().map(|name| term(name)));
        row.push(validation.map_or(String::new(), |v| format!("{:.3}", v.psnr)));
        row.push(validation.map_or(String::new(), |v| format!("{:.4}", v.mask_iou)));
        row.push(format!("{cpu_seconds:.3}"));
        row.push(chamfer_l1.map_or(String::new(), |distance| format!("{distance:.6}")));
        self.rows.push(row);
    }

    /// Writes the file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut text = header().join(",");
        text.push('\n');
        for row in &self.rows {
            text.push_str(&row.join(","));
            text.push('\n');
        }
        Ok(dvr_core::files::write_bytes_atomically(path, text.as_bytes())?)
    }
}
