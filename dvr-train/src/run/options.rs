//! How a run is carried out, and what it leaves in memory.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use burn::tensor::Device;
use dvr_core::PointCloud;
use dvr_render::ViewMetrics;

use super::checkpoint::Checkpoint;
use super::folder::RunFolder;
use crate::cameras::RefinedCameras;

/// How a run is carried out, besides its configuration.
pub struct RunOptions<'a> {
    /// The folder.
    pub folder: RunFolder,
    /// The device, without autodiff.
    pub device: Device,
    /// Devices that share each step of a network with it, without autodiff too.
    pub helpers: Vec<Device>,
    /// How the scene was read; stored in checkpoints.
    pub reading: serde_json::Value,
    /// Wall time after which training stops as if its steps were done.
    pub time_limit: Option<Duration>,
    /// What became of the scene's cameras, where they were refined.
    pub refined: Option<RefinedCameras>,
    /// The true surface, with which the shape is compared at each validation, beside the clock: a column of
    /// `metrics.csv`. It teaches nothing.
    pub truth: Option<&'a PointCloud>,
    /// Set from outside (Ctrl-C): training saves and stops after the current step.
    pub interrupted: &'a AtomicBool,
}

/// Why training stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// All steps are done.
    Done,
    /// The time is up.
    TimeLimit,
    /// Somebody asked.
    Interrupted,
}

/// What training left.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The checkpoint that stands for the run.
    pub checkpoint: Checkpoint,
    /// Why it stopped.
    pub stop: Stop,
    /// Steps done, over all sessions.
    pub steps: usize,
    /// Wall seconds of training, over all sessions.
    pub seconds: f64,
    /// Wall and CPU seconds of this session that went into comparing the shape with the truth; they are not in
    /// `seconds`.
    pub measuring_seconds: [f64; 2],
    /// The last validation.
    pub validation: Option<ViewMetrics>,
}
