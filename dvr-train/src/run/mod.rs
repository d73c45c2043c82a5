//! Run folders: checkpoints, curves, and the loop that writes them.

pub(crate) mod best;
mod chamfer_curve;
pub(crate) mod checkpoint;
pub(crate) mod folder;
pub(crate) mod metrics_log;
pub(crate) mod options;
pub(crate) mod train;
pub(crate) mod training_loop;
