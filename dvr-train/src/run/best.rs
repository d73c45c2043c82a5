//! The validation by which the step is chosen that stands for a run.

use serde::{Deserialize, Serialize};

/// The best validation of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// The step after which it was measured.
    pub step: usize,
    /// PSNR on pixels of validation views, dB.
    pub psnr: f64,
    /// IoU of the silhouettes on the same pixels.
    pub mask_iou: f64,
}
