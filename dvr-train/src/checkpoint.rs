//! Checkpoints: everything a run needs to go on as if it had not been interrupted, in one file.
//!
//! The container is safetensors: a JSON header with the format's version and the full configuration, and two byte
//! tensors, `model` and `optimizer`, that hold burn's own records (which keep parameter identities, so that the
//! optimiser's moments find their parameters again).

use std::collections::HashMap;
use std::path::Path;

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::ModuleRecord;
use burn::tensor::Bytes;
use dvr_core::Similarity;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde::{Deserialize, Serialize};

use crate::config::TrainConfig;
use crate::error::{Error, Result};

/// Version of the checkpoints that this program writes.
pub const CHECKPOINT_VERSION: u32 = 1;

/// Key of the JSON header among the container's metadata.
const HEADER_KEY: &str = "dvr-checkpoint";

/// What a checkpoint says about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckpointHeader {
    /// Format version.
    pub version: u32,
    /// The full configuration of the run.
    pub config: TrainConfig,
    /// Optimiser steps done.
    pub step: usize,
    /// Wall seconds of training so far, over all sessions.
    pub seconds: f64,
    /// The best validation so far.
    pub best: Option<Best>,
    /// The scene's folder, as the user gave it.
    pub scene: std::path::PathBuf,
    /// How the scene was read: what `dvr render` and `dvr eval` need to read it again in the same way.
    pub reading: serde_json::Value,
    /// Takes object space to the world of the scene's files.
    pub object_to_world: Similarity,
    /// Views that were held out, by name.
    pub held_out: Vec<String>,
}

/// The best validation of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// The step after which it was measured.
    pub step: usize,
    /// PSNR on held-out pixels, dB.
    pub psnr: f64,
}

/// A checkpoint in memory.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// What it says about itself.
    pub header: CheckpointHeader,
    model: Vec<u8>,
    optimizer: Vec<u8>,
}

impl Checkpoint {
    /// Takes the state of a run.
    ///
    /// # Errors
    /// Only where a tensor cannot be read back from its device.
    pub fn new<M: Module>(header: CheckpointHeader, model: M, optimizer: &ModuleOptimizer) -> Result<Self> {
        let broken = |e: burn::store::RecordError| Error::Config(format!("the model cannot be stored: {e}"));
        let model = model.into_record().into_bytes().map_err(broken)?.to_vec();
        let optimizer = optimizer.into_bytes().map_err(broken)?.to_vec();
        Ok(Self { header, model, optimizer })
    }

    /// Writes the checkpoint under a temporary name and renames it.
    ///
    /// # Errors
    /// When the file cannot be written; an older file of that name is then untouched.
    pub fn save(&self, path: &Path) -> Result<()> {
        let fail = |e: String| Error::Run {
            path: path.to_owned(),
            problem: format!("the checkpoint cannot be written: {e}"),
            remedy: "Check the disk.".into(),
        };
        let view = |bytes| TensorView::new(Dtype::U8, vec![<[u8]>::len(bytes)], bytes).map_err(|e| fail(e.to_string()));
        let header = serde_json::to_string(&self.header).map_err(|e| fail(e.to_string()))?;
        let metadata = HashMap::from([(HEADER_KEY.to_owned(), header)]);
        let tensors = [("model", view(&self.model)?), ("optimizer", view(&self.optimizer)?)];
        let bytes = serialize(tensors, Some(metadata)).map_err(|e| fail(e.to_string()))?;
        Ok(dvr_core::files::write_bytes_atomically(path, &bytes)?)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// When the file is missing, is not a checkpoint, is cut short, or was written by a newer program.
    pub fn load(path: &Path) -> Result<Self> {
        let refuse = |problem: String| Error::Run {
            path: path.to_owned(),
            problem,
            remedy: "Give the folder of a run that `dvr train` wrote, or one of its checkpoints.".into(),
        };
        let bytes = std::fs::read(path).map_err(|e| dvr_core::Error::io(path, e))?;
        let (_, metadata) =
            SafeTensors::read_metadata(&bytes).map_err(|e| refuse(format!("this is not a checkpoint ({e})")))?;
        let header = metadata.metadata().as_ref().and_then(|m| m.get(HEADER_KEY));
        let header = header.ok_or_else(|| refuse("this safetensors file is not a checkpoint of dvr".into()))?;
        let value: serde_json::Value = serde_json::from_str(header).map_err(|e| refuse(e.to_string()))?;
        let version = value.get("version").and_then(serde_json::Value::as_u64).unwrap_or(0);
        if version != u64::from(CHECKPOINT_VERSION) {
            let problem = format!("checkpoint version {version}; this program reads version {CHECKPOINT_VERSION}");
            return Err(refuse(problem));
        }
        let header = serde_json::from_value(value).map_err(|e| refuse(format!("the header is broken ({e})")))?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|e| refuse(format!("the file is cut short ({e})")))?;
        let blob = |name: &str| -> Result<Vec<u8>> {
            let tensor = tensors.tensor(name).map_err(|e| refuse(format!("{name} is missing ({e})")))?;
            Ok(tensor.data().to_vec())
        };
        Ok(Self { header, model: blob("model")?, optimizer: blob("optimizer")? })
    }

    /// Puts the stored parameters into `model`.
    ///
    /// # Errors
    /// When their names or shapes are not those of `model`.
    pub fn restore_model<M: Module>(&self, model: M) -> Result<M> {
        let record = ModuleRecord::from_bytes(Bytes::from_bytes_vec(self.model.clone()));
        record
            .and_then(|record| model.try_load_record(record))
            .map_err(|e| Error::Config(format!("the checkpoint's parameters do not fit its own configuration: {e}")))
    }

    /// Puts the stored moments into `optimizer`.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn restore_optimizer(&self, optimizer: ModuleOptimizer) -> Result<ModuleOptimizer> {
        optimizer
            .from_bytes(Bytes::from_bytes_vec(self.optimizer.clone()))
            .map_err(|e| Error::Config(format!("the checkpoint's optimiser state cannot be read: {e}")))
    }
}
