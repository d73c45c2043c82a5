//! The dataset of a run over many objects.

use anyhow::{Context, Result};
use dvr_core::dataset::ObjectOptions;
use dvr_train::Checkpoint;

/// How the dataset of a run was read.
pub fn options_of_run(checkpoint: &Checkpoint) -> Result<ObjectOptions> {
    let reading = checkpoint.header.reading.clone();
    serde_json::from_value(reading).context("the checkpoint does not say how its dataset was read")
}
