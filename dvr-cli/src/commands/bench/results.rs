//! Outcomes of runs, ours or other software's, as they are stored.

use std::path::Path;

use anyhow::{Context, Result};
use dvr_core::files::write_bytes_atomically;
use dvr_core::record::RecordKey;
use dvr_train::{PointsEvaluation, RunMetrics};
use serde::{Deserialize, Serialize};

/// `results.json`.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Results {
    /// One per run.
    pub outcomes: Vec<Outcome>,
}

/// The figures of one run. Lengths are in edges of the object cube. Figures that were not measured may be missing, so that
/// other software's results can be written by hand.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outcome {
    /// The scene.
    pub scene: String,
    /// The method, or the variant of it.
    pub method: String,
    /// What supervised it.
    #[serde(default)]
    pub supervision: String,
    /// The seed.
    #[serde(default)]
    pub seed: u64,
    /// Why there are no figures: what the program said last.
    #[serde(default)]
    pub failure: Option<String>,
    /// Wall seconds of the whole job, from the start of the program to its end.
    #[serde(default)]
    pub seconds: Option<f64>,
    /// Wall seconds of training with its preparation.
    #[serde(default)]
    pub training_seconds: Option<f64>,
    /// CPU seconds of the whole job.
    #[serde(default)]
    pub cpu_seconds: Option<f64>,
    /// Peak memory, bytes.
    #[serde(default)]
    pub peak_memory: Option<u64>,
    /// Cells along an edge of the cube, of a grid.
    #[serde(default)]
    pub cells: Option<usize>,
    /// Bytes of the stored model.
    #[serde(default)]
    pub bytes: Option<usize>,
    /// Faces of the mesh; 0 where there is none.
    #[serde(default)]
    pub faces: Option<usize>,
    /// Chamfer-L1 against the true surface.
    #[serde(default)]
    pub chamfer_l1: Option<f64>,
    /// Chamfer-L1 of two samplings of the true surface.
    #[serde(default)]
    pub floor: Option<f64>,
    /// Normal consistency.
    #[serde(default)]
    pub normals: Option<f64>,
    /// Volume IoU.
    #[serde(default)]
    pub volume_iou: Option<f64>,
    /// Mean distance from verified points to the mesh, in the units of the files.
    #[serde(default)]
    pub points_mean: Option<f64>,
    /// Median of these.
    #[serde(default)]
    pub points_median: Option<f64>,
    /// PSNR of renders of the coloured mesh on test views, dB.
    #[serde(default)]
    pub psnr: Option<f64>,
    /// IoU of its silhouettes there.
    #[serde(default)]
    pub mask_iou: Option<f64>,
    /// What the figures were made of; other software's may be unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key: Option<RecordKey>,
}

impl Outcome {
    /// A run of this program without figures.
    pub fn blank(scene: &str, method: &str, supervision: &str, seed: u64, key: &RecordKey) -> Self {
        Self {
            scene: scene.to_owned(),
            method: method.to_owned(),
            supervision: supervision.to_owned(),
            seed,
            key: Some(key.clone()),
            ..Self::default()
        }
    }

    /// The same run with its figures; `points` are those of the mesh against verified points.
    pub fn measured(self, seconds: f64, metrics: &RunMetrics, points: Option<&PointsEvaluation>) -> Self {
        // Without a mesh there is no distance.
        let surface = metrics.shape.surface.as_ref().filter(|_| metrics.mesh.is_some());
        Self {
            // Measurements for the benchmark are not part of the job.
            seconds: Some(seconds - metrics.measuring_seconds[0]),
            training_seconds: Some(metrics.training_seconds),
            cpu_seconds: Some(metrics.resources.cpu_seconds - metrics.measuring_seconds[1]),
            peak_memory: metrics.resources.peak_memory,
            cells: metrics.cells,
            bytes: Some(metrics.bytes),
            faces: Some(metrics.mesh.map_or(0, |[_, faces]| faces)),
            chamfer_l1: surface.map(|score| score.chamfer_l1),
            floor: metrics.shape.floor.as_ref().map(|score| score.chamfer_l1),
            normals: surface.and_then(|score| Some(score.normal_consistency?.mean)),
            volume_iou: metrics.shape.volume_iou,
            points_mean: points.map(|points| points.score.distances.mean),
            points_median: points.map(|points| points.score.distances.median),
            psnr: metrics.test_mesh.map(|view_metrics| view_metrics.psnr),
            mask_iou: metrics.test_mesh.map(|view_metrics| view_metrics.mask_iou),
            ..self
        }
    }

    /// Whether the run ended with a mesh.
    pub fn has_succeeded(&self) -> bool {
        self.failure.is_none() && self.faces != Some(0)
    }
}

impl Results {
    /// Writes them.
    pub fn write(&self, path: &Path) -> Result<()> {
        Ok(write_bytes_atomically(path, serde_json::to_string_pretty(self)?.as_bytes())?)
    }
}

/// The outcomes in a file: a `results.json`, or a bare list of them.
pub fn read(path: &Path) -> Result<Vec<Outcome>> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let value: serde_json::Value =
        serde_json::from_str(&text).with_context(|| format!("{} is not JSON", path.display()))?;
    let outcomes = value.get("outcomes").cloned().unwrap_or(value);
    serde_json::from_value(outcomes).with_context(|| {
        format!("{}: write a list of {{\"scene\", \"method\", \"seconds\", \"chamfer_l1\", ...}}", path.display())
    })
}
