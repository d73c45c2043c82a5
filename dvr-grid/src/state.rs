//! What a run needs to go on: parameters and moments of all levels, as safetensors.

use std::collections::HashMap;

use dvr_core::Exposure;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::growth::Reached;
use crate::multires::Grids;

/// Key of the JSON among the container's metadata.
const PROGRESS_KEY: &str = "progress";

/// How far a run has come, besides its steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Progress {
    /// Steps done before the present pass.
    pub pass_start: usize,
    /// Passes that followed at the size that is kept, this one among them.
    pub further: usize,
    /// Cells along an edge of the present shape grid.
    pub cells: usize,
    pub reached: Vec<Reached>,
    pub has_kept: bool,
    pub finished: bool,
    pub rays_drawn: u64,
    /// How far views agree on raw colours, as the bits of a number. Earlier builds kept how far these count, which is
    /// measured anew within fifty steps.
    #[serde(alias = "color_trust")]
    pub agreement: u64,
    /// Whether stereo was left out of the start, which parameters are added to.
    #[serde(default)]
    pub doubts_stereo: bool,
    /// The exposure of each training view; empty where all are as they are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exposures: Vec<Exposure>,
}

fn broken(problem: impl std::fmt::Display) -> Error {
    Error::State(problem.to_string())
}

/// Names of the present levels, and of those that growth may be taken back to.
pub(crate) const PRESENT: [&str; 2] = ["shape", "color"];
pub(crate) const KEPT: [&str; 2] = ["kept_shape", "kept_color"];

/// Names of what the stages before the present one learned.
const LEARNED: [&str; 2] = ["shape_learned", "color_learned"];

/// Everything as bytes.
pub(crate) fn to_bytes(progress: &Progress, present: &Grids, kept: Option<&Grids>) -> Result<Vec<u8>> {
    let named = [(PRESENT, Some(present)), (KEPT, kept)];
    let mut tensors: Vec<(String, Vec<u8>)> = Vec::new();
    let mut add = |name: String, values: Vec<f32>| {
        let mut bytes = vec![0; 4 * values.len()];
        bytes.as_chunks_mut::<4>().0.iter_mut().zip(values).for_each(|(bytes, value)| *bytes = value.to_le_bytes());
        tensors.push((name, bytes));
    };
    for (names, grids) in named {
        let Some(Grids { shape, color }) = grids else { continue };
        add(names[0].into(), shape.state());
        add(names[1].into(), color.state());
    }
    // Those that growth may be taken back to started from a part of it.
    for (name, learned) in LEARNED.into_iter().zip([present.shape.learned(), present.color.learned()]) {
        learned.into_iter().for_each(|learned| add(name.into(), learned));
    }
    let views = tensors.iter().map(|(name, bytes)| {
        TensorView::new(Dtype::F32, vec![bytes.len() / 4], bytes).map(|view| (name.as_str(), view)).map_err(broken)
    });
    let metadata = HashMap::from([(PROGRESS_KEY.to_owned(), serde_json::to_string(progress).map_err(broken)?)]);
    serialize(views.collect::<Result<Vec<_>>>()?, Some(metadata)).map_err(broken)
}

/// How far the run had come.
pub(crate) fn progress(bytes: &[u8]) -> Result<Progress> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(broken)?;
    let text = metadata.metadata().as_ref().and_then(|m| m.get(PROGRESS_KEY)).ok_or_else(|| broken("no progress"))?;
    serde_json::from_str(text).map_err(broken)
}

/// What the stages before one on a frozen base learned, of shape and colour; `None` where there is no frozen base.
pub(crate) fn learned(bytes: &[u8]) -> Result<Option<(Vec<f32>, Vec<f32>)>> {
    let tensors = SafeTensors::deserialize(bytes).map_err(broken)?;
    let [shape, color] = LEARNED.map(|name| values(&tensors, name).ok());
    Ok(shape.zip(color))
}

fn values(tensors: &SafeTensors, name: &str) -> Result<Vec<f32>> {
    let tensor = tensors.tensor(name).map_err(broken)?;
    let (words, _) = tensor.data().as_chunks::<4>();
    Ok(words.iter().map(|&word| f32::from_le_bytes(word)).collect())
}

/// The state was learned on another start than this build makes.
pub(crate) fn started_otherwise() -> Error {
    broken("another build of the program began it, whose start had stereo where this one leaves it out: train anew")
}

/// The state does not belong to this run.
pub(crate) fn misfit() -> Error {
    broken("it is that of other masks or another configuration")
}

/// Puts the parameters back into grids with the same nodes.
pub(crate) fn restore(bytes: &[u8], names: [&str; 2], grids: &mut Grids) -> Result<()> {
    let tensors = SafeTensors::deserialize(bytes).map_err(broken)?;
    let Grids { shape, color } = grids;
    let fits = shape.restore(&values(&tensors, names[0])?) && color.restore(&values(&tensors, names[1])?);
    if fits { Ok(()) } else { Err(misfit()) }
}
