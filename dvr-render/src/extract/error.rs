//! Why there is no mesh.

use dvr_core::Cancelled;
use dvr_core::number_range::OutOfRange;
use glam::Vec3;

/// Result of an extraction.
pub type Result<T> = std::result::Result<T, ExtractError>;

/// Why a field gave no mesh, with the values found and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExtractError {
    /// Somebody wanted it to end.
    #[error("{0}")]
    Cancelled(#[from] Cancelled),
    /// The level set does not meet the cube, not even on the final grid.
    #[error(
        "there is no surface: all {evaluations} logits on the grid of {resolution}^3 cells lie {} the level {level} \
         (from {min} to {max}). {}",
        if *inside { "at or above" } else { "below" },
        if *inside { "Train longer, or raise the level above the smallest logit." }
        else { "Train longer, or lower the level below the largest logit." }
    )]
    NoSurface {
        /// Whether the field is inside everywhere (else it is outside everywhere).
        inside: bool,
        /// The level asked for.
        level: f32,
        /// Smallest logit found.
        min: f32,
        /// Largest logit found.
        max: f32,
        /// Cells along an edge of the finest grid that was searched.
        resolution: usize,
        /// How many points were evaluated.
        evaluations: usize,
    },
    /// The field answered NaN (or, for gradients and colours, infinity).
    #[error(
        "{count} of {points} {what} in a batch are not numbers, the first at ({}, {}, {}). \
         The field has diverged: use an earlier checkpoint, or train with a lower learning rate.",
        first.x, first.y, first.z
    )]
    NotANumber {
        /// "logits", "gradients" or "colors".
        what: &'static str,
        /// How many in the batch.
        count: usize,
        /// Size of the batch.
        points: usize,
        /// Where the first one was found.
        first: Vec3,
    },
    /// The field gave more or fewer answers than it was asked for.
    #[error("the field answered {answers} {what} for {points} points. It must answer one per point.")]
    AnswerLength {
        /// "logits", "gradients" or "colors".
        what: &'static str,
        /// Points asked for.
        points: usize,
        /// Answers given.
        answers: usize,
    },
    /// A setting that cannot be used.
    #[error(transparent)]
    Setting(#[from] OutOfRange),
}
