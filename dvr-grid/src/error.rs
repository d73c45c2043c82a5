//! Errors of the grid method.

/// Result of anything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// What went wrong.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Somebody wanted the work to end.
    #[error("{0}")]
    Cancelled(#[from] dvr_core::Cancelled),
    /// The scene cannot be used.
    #[error(transparent)]
    Scene(#[from] dvr_core::Error),
    /// A configuration value is out of range.
    #[error(transparent)]
    OutOfRange(#[from] dvr_core::number_range::OutOfRange),
    /// No point of space is object in all masks.
    #[error("the masks have no visual hull in common: no point of space is object in all of them")]
    NoHull,
    /// A stored field cannot be read or written.
    #[error(transparent)]
    Field(#[from] crate::field::file::GridFormatError),
    /// A training state is damaged, or belongs to other masks or another configuration.
    #[error("the training state cannot be used: {0}")]
    State(String),
    /// The loss is no longer a number.
    #[error("the loss became {value} in step {step}")]
    Diverged {
        /// The step.
        step: usize,
        /// The loss.
        value: f64,
    },
    /// A GPU refused.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Device(#[from] dvr_gpu::DeviceError),
}
