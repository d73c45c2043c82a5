//! What can go wrong between photographs and masks.

use dvr_core::Cancelled;

/// What went wrong, for the person who holds the photographs.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SegmentationError {
    /// Somebody wanted the work to end.
    #[error("{0}")]
    Cancelled(#[from] Cancelled),
    /// Too few views to compare.
    #[error("{found} views may be looked at, and the object is told from its background by {least} or more")]
    TooFewViews {
        /// How many there are that are not for testing.
        found: usize,
        /// How many there must be.
        least: usize,
    },
    /// No volume that the views agree about.
    #[error("no object was found that the views agree about, near what all cameras look at")]
    NothingFound,
}
