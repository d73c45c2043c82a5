//! Checkpoints: everything a run needs to go on as if it had not been interrupted, in one file.
//!
//! The container is safetensors: a JSON header with the format's version and the full configuration, and two byte
//! tensors, `model` and `training`. For a network they hold burn's own records (which keep parameter identities, so
//! that the optimiser's moments find their parameters again); for a grid field the compact field that
//! `dvr_grid::grid_file` writes, and what training needs besides.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use dvr_core::{Camera, Exposure, Similarity, ViewNames};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::export::real_size::KnownLength;
use crate::export::support::Support;
use crate::learners::learner::LearnerState;
use crate::methods::record::{CommonSettings, MethodRecord};
use crate::run::best::Best;

/// Version of the checkpoints that this program writes.
pub const CHECKPOINT_VERSION: u32 = 8;

/// Key of the JSON header among the container's metadata.
const HEADER_KEY: &str = "dvr-checkpoint";

/// What a checkpoint says about itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckpointHeader {
    /// Format version.
    pub version: u32,
    /// The method and the full configuration of the run: the keys `method` and `config`.
    #[serde(flatten)]
    pub method: MethodRecord,
    /// What every configuration has.
    pub common: CommonSettings,
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
    /// Which views are trained on, which validate and which test: fixed at the start of the run. `None` where that is
    /// not known, of imported runs, and of datasets of objects.
    pub views: Option<ViewNames>,
    /// Cameras in object space that replace those of the files, by view: where they were refined.
    #[serde(default)]
    pub cameras: BTreeMap<String, Camera>,
    /// Rounds, at most, in which the cameras were refined; 0 where the files are believed.
    #[serde(default)]
    pub refine_cameras: usize,
    /// What takes the training views to their mean exposure, by view: where the run found that the light changes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub exposures: BTreeMap<String, Exposure>,
    /// Known lengths, by which the results get their real size.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lengths: Vec<KnownLength>,
    /// What the object stands on, where that was found with its masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<Support>,
    /// What was decided on the way and why, for people: how fine the field became, say.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// A checkpoint in memory.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// What it says about itself.
    pub header: CheckpointHeader,
    /// The state.
    pub state: LearnerState,
}

impl Checkpoint {
    /// Writes the checkpoint under a temporary name and renames it.
    ///
    /// # Errors
    /// When the file cannot be written; an older file of that name is then untouched.
    pub fn save(&self, path: &Path) -> Result<()> {
        let fail = |problem: String| Error::NotStored { problem };
        let view = |bytes| TensorView::new(Dtype::U8, vec![<[u8]>::len(bytes)], bytes).map_err(|e| fail(e.to_string()));
        let header = serde_json::to_string(&self.header).map_err(|e| fail(e.to_string()))?;
        let metadata = HashMap::from([(HEADER_KEY.to_owned(), header)]);
        let tensors = [("model", view(&self.state.model)?), ("training", view(&self.state.training)?)];
        let bytes = serialize(tensors, Some(metadata)).map_err(|e| fail(e.to_string()))?;
        Ok(dvr_core::files::write_bytes_atomically(path, &bytes)?)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// When the file is missing, is not a checkpoint, is cut short, or was written by another version of the program.
    pub fn load(path: &Path) -> Result<Self> {
        let refuse = |problem: String| Error::NotACheckpoint { path: path.to_owned(), problem };
        let bytes = dvr_core::files::read_bytes(path)?;
        let (_, metadata) =
            SafeTensors::read_metadata(&bytes).map_err(|e| refuse(format!("this is not a checkpoint ({e})")))?;
        let header = metadata.metadata().as_ref().and_then(|m| m.get(HEADER_KEY));
        let header = header.ok_or_else(|| refuse("this safetensors file is not a checkpoint of dvr".into()))?;
        let value: serde_json::Value = serde_json::from_str(header).map_err(|e| refuse(e.to_string()))?;
        let version = value.get("version").and_then(serde_json::Value::as_u64).unwrap_or(0);
        if version != u64::from(CHECKPOINT_VERSION) {
            return Err(Error::CheckpointVersion {
                path: path.to_owned(),
                found: version,
                expected: CHECKPOINT_VERSION,
            });
        }
        let header = serde_json::from_value(value).map_err(|e| refuse(format!("the header is broken ({e})")))?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|e| refuse(format!("the file is cut short ({e})")))?;
        let blob = |name: &str| -> Result<Vec<u8>> {
            let tensor = tensors.tensor(name).map_err(|e| refuse(format!("{name} is missing ({e})")))?;
            Ok(tensor.data().to_vec())
        };
        Ok(Self { header, state: LearnerState { model: blob("model")?, training: blob("training")? } })
    }
}

#[cfg(test)]
mod tests {
    use dvr_core::Supervision;

    use super::*;
    use crate::methods::method_by_name;

    #[test]
    fn every_number_comes_back_bit_for_bit() {
        let method = method_by_name("grid", Supervision::Rgb).unwrap();
        // Numbers whose text a quick parser misreads by one unit in the last place.
        let numbers = [0.47960756426982587, 0.19813640638684982, 0.9519560284026387];
        let [scale, psnr, mask_iou] = numbers;
        let header = CheckpointHeader {
            version: CHECKPOINT_VERSION,
            method: method.record().unwrap(),
            common: method.common(),
            step: 7,
            seconds: 0.9259338926496359,
            best: Some(Best { step: 5, psnr, mask_iou }),
            scene: "scene".into(),
            reading: serde_json::json!({ "numbers": numbers }),
            object_to_world: Similarity { scale, translation: numbers.into(), ..Similarity::default() },
            views: None,
            cameras: BTreeMap::new(),
            refine_cameras: 0,
            exposures: BTreeMap::new(),
            lengths: Vec::new(),
            support: None,
            notes: Vec::new(),
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("last.ckpt");
        let state = LearnerState { model: vec![1], training: vec![2, 3] };
        Checkpoint { header: header.clone(), state }.save(&path).unwrap();
        assert_eq!(Checkpoint::load(&path).unwrap().header, header);
    }
}
