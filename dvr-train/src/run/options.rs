//! How a run is carried out, and what it leaves in memory.

use std::time::Duration;

use burn::tensor::Device;
use dvr_core::metrics::depth_maps::StereoDepth;
use dvr_core::{Cancellation, ViewNames};
use dvr_render::ViewMetrics;

use super::checkpoint::{Checkpoint, CheckpointHeader};

use super::folder::RunFolder;
use crate::export::real_size::KnownLength;
use crate::export::support::Support;
use crate::learners::learner::LearnerState;
use crate::methods::trained_model::TrainedModel;

/// How a run is carried out, besides its method.
pub struct RunOptions {
    /// The folder.
    pub folder: RunFolder,
    /// The device, without autodiff.
    pub device: Device,
    /// Devices that share each step of a network with it, without autodiff too.
    pub data_parallel: Vec<Device>,
    /// How the scene was read; stored in checkpoints.
    pub reading: serde_json::Value,
    /// What the views of the scene are for, where it has been divided already ([`dvr_core::Scene::hold_out`]); a run
    /// that starts without divides it, and one that is resumed goes by its checkpoint.
    pub views: Option<ViewNames>,
    /// Wall time after which training stops as if its steps were done.
    pub time_limit: Option<Duration>,
    /// Rounds, at most, in which the scene's cameras are moved to where they fit together before training; 0 believes
    /// the files.
    pub refine_cameras: usize,
    /// Whether the shape is compared with the scene's true surface at each validation, beside the clock: a column of
    /// `metrics.csv`. Nothing is learned from it.
    pub follow_shape: bool,
    /// Known lengths, by which the results get their real size; `None` for those of the checkpoint, where a run is resumed.
    pub lengths: Option<Vec<KnownLength>>,
    /// What the object stands on, where that is known; a run that is resumed goes by its checkpoint.
    pub support: Option<Support>,
    /// Asks the run to end (Ctrl-C): training saves and stops after the current step.
    pub cancellation: Cancellation,
}

impl RunOptions {
    /// A run in a folder, on a device, and nothing else.
    pub fn new(folder: RunFolder, device: Device) -> Self {
        Self {
            folder,
            device,
            data_parallel: Vec::new(),
            reading: serde_json::Value::Null,
            views: None,
            time_limit: None,
            refine_cameras: 0,
            follow_shape: false,
            lengths: None,
            support: None,
            cancellation: Cancellation::default(),
        }
    }
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

/// How a run went.
#[derive(Clone, Debug)]
pub struct RunOutcome {
    /// The header of the checkpoint that stands for the run: of the best step, or of the last where nothing was
    /// validated or the run was interrupted.
    pub header: CheckpointHeader,
    /// The model of that step, as checkpoints store it.
    pub model: Vec<u8>,
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
    /// The depths that the method found in the training views before training, where it looked for some.
    pub stereo_depths: Vec<StereoDepth>,
}

impl RunOutcome {
    /// A checkpoint without what only training needs: small, and all that rendering, extraction and evaluation ask for.
    pub fn final_model(&self) -> Checkpoint {
        let state = LearnerState { model: self.model.clone(), training: Vec::new() };
        Checkpoint { header: self.header.clone(), state }
    }
}

/// A trained scene.
pub struct Trained {
    /// The model that stands for the run, ready to be rendered and extracted.
    pub model: Box<dyn TrainedModel>,
    /// How the run went.
    pub outcome: RunOutcome,
}
