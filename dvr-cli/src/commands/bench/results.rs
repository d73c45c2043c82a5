//! Outcomes of runs, ours or other software's, as they are stored.

use std::path::Path;

use anyhow::{Context, Result};
use dvr_core::files::write_bytes_atomically;
use dvr_train::RunMetrics;
use serde::{Deserialize, Serialize};

use crate::commands::machine::Machine;

/// `results.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Results {
    /// The machine and the program.
    pub machine: Machine,
    /// One per run.
    pub outcomes: Vec<Outcome>,
}

/// The figures of one run. Lengths are in edges of the object cube. Figures that were not measured may be missing, so that
/// other software's results can be written by hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Wall seconds of the whole job, from the start of the program to its end.
    pub seconds: f64,
    /// Wall seconds of training with its preparation.
    #[serde(default)]
    pub training_seconds: Option<f64>,
    /// CPU seconds of the whole job.
    #[serde(default)]
    pub cpu_seconds: Option<f64>,
    /// Peak memory, bytes.
    #[serde(default)]
    pub peak_memory: Option<u64>,
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
    /// PSNR of renders of the coloured mesh on held-out views, dB.
    #[serde(default)]
    pub psnr: Option<f64>,
    /// IoU of its silhouettes there.
    #[serde(default)]
    pub mask_iou: Option<f64>,
}

impl Outcome {
    /// The outcome of a run of this program.
    pub fn new(scene: &str, method: &str, supervision: &str, seconds: f64, metrics: &RunMetrics) -> Self {
        // Without a mesh there is no distance.
        let surface = metrics.shape.surface.as_ref().filter(|_| metrics.mesh.is_some());
        Self {
            scene: scene.to_owned(),
            method: method.to_owned(),
            supervision: supervision.to_owned(),
            seed: metrics.seed,
            // Measurements for the benchmark are not part of the job.
            seconds: seconds - metrics.measuring_seconds[0],
            training_seconds: Some(metrics.training_seconds),
            cpu_seconds: Some(metrics.resources.cpu_seconds - metrics.measuring_seconds[1]),
            peak_memory: metrics.resources.peak_memory,
            bytes: Some(metrics.bytes),
            faces: Some(metrics.mesh.map_or(0, |[_, faces]| faces)),
            chamfer_l1: surface.map(|score| score.chamfer_l1),
            floor: metrics.shape.floor.as_ref().map(|score| score.chamfer_l1),
            normals: surface.and_then(|score| Some(score.normal_consistency?.mean)),
            volume_iou: metrics.shape.volume_iou,
            psnr: metrics.held_out_mesh.map(|view_metrics| view_metrics.psnr),
            mask_iou: metrics.held_out_mesh.map(|view_metrics| view_metrics.mask_iou),
        }
    }
}

impl Results {
    /// No results yet.
    pub fn new(machine: Machine) -> Self {
        Self { machine, outcomes: Vec::new() }
    }

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
